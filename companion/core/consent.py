"""The permission to land from samples: the pilot's switch, the vehicle's state and health, put to the gate."""

from companion.core.health import HealthMonitor
from companion.core.pilot import PilotControls
from companion.core.vehicle_state import VehicleState
from companion.messages.conditions import Code
from companion.settings.settings import LandingSettings
from drivers.samples import Sample
from landing.decision.permission import Gate, Permission, Phase, Position, Seen, Switch, objections
from landing.decision.withheld import Objection, Withheld

STATUS_MAX_AGE_S = 5.0
"""SYS_STATUS that came and then stopped for this long leaves it unknown whether the radio is heard."""


class Consent:
    """Keeps the permission and asks the gate.

    ``by_pilot``: the switch that the settings name gives the permission; otherwise it is given by hand
    (``landing.enabled``, ``set_enabled``), as in a replay.
    """

    def __init__(self, settings: LandingSettings, health: HealthMonitor, *, by_pilot: bool) -> None:
        self._s = settings
        self._health = health
        switch = Switch()
        if by_pilot:
            modes = frozenset(settings.enable_modes)
            switch = Switch(settings.enable_rc_channel > 0, modes, settings.stick_limit_us)
        self._switch = switch
        self.permission = Permission(switch)
        self.vehicle = VehicleState()
        self.radio_lost = False
        """Whether the radio that the pilot would take over with is lost, or its switch is not heard."""
        self._controls = PilotControls(settings)
        self._hand = Position.ON if settings.enabled else Position.OFF

    def set_enabled(self, enabled: bool, now_us: int) -> None:
        """Turn the switch by hand."""
        self._hand = Position.ON if enabled else Position.OFF
        self.step(now_us)

    def feed(self, sample: Sample, now_us: int) -> None:
        """Take one sample."""
        self.vehicle.feed(sample, now_us)
        self._controls.feed(sample, now_us)
        if self.vehicle.pilot_took_over:
            self.permission.end(Withheld.TAKEN_OVER)
        self.step(now_us)

    def heard(self, now_us: int) -> bool:
        """Whether the autopilot's heartbeat comes."""
        return self._health.state("heartbeat", now_us) == "ok"

    def step(self, now_us: int) -> None:
        """Bring the permission up to the present moment."""
        v = self.vehicle
        heard = self.heard(now_us)
        radio = self._controls.radio(now_us)
        self.radio_lost = v.radio_lost or (self._switch.radio and radio is Position.UNCLEAR)
        self.permission.step(
            Seen(
                hand=self._hand,
                radio=radio,
                mode=v.mode if heard else None,
                intended=v.intended,
                failsafe=v.failsafe,
                radio_lost=v.radio_lost,
                armed=v.armed,
                sticks=self._controls.sticks,
            )
        )

    def reboot(self) -> None:
        """The autopilot rebooted: nothing it said holds any more, nor what its pilot's switch permitted."""
        self.vehicle.forget()
        if not self._switch.by_hand:
            self.permission.end(Withheld.REBOOTED)

    def objections(self, now_us: int, *, command_busy: bool) -> tuple[Objection, ...]:
        """What stands against a request now; empty when one may go out."""
        self.step(now_us)
        v, stale = self.vehicle, self._health.stale(now_us)
        heard = "heartbeat" not in stale
        landed = None if "landed_state" in stale or v.landed is None else v.landed.state
        age_s, wrong = v.radio_age_s(now_us), self._health.standing_codes()
        if self._switch.radio and age_s is not None and age_s > STATUS_MAX_AGE_S:
            stale = (*stale, "system_status")
        gate = Gate(
            armed=v.armed if heard else None,
            landed=landed,
            mode_allowed=v.mode in self._s.allowed_modes if heard and v.mode is not None else None,
            failsafe=v.failsafe,
            ready=v.ready,
            radio_lost=v.radio_lost,
            vehicle=v.kind,
            allowed_vehicles=frozenset(name.lower() for name in self._s.vehicle_types),
            stale=stale,
            attitude_missing=Code.ATTITUDE_MISSING in wrong,
            two_vehicles=Code.TWO_VEHICLES in wrong,
            calibrated=Code.UNCALIBRATED not in wrong,
            camera_frozen=Code.CAMERA_FROZEN in wrong,
            image_size_wrong=Code.IMAGE_SIZE in wrong,
            command_busy=command_busy,
        )
        return objections(self.permission, gate)

    @property
    def against_enabling(self) -> str:
        """Why landing is not enabled, in words; empty when it is. An event reports every change."""
        permission = self.permission
        if permission.phase not in (Phase.STANDING, Phase.USED):
            return str(permission.objection)
        wrong = self._health.standing_codes()
        if Code.UNCALIBRATED in wrong:
            return f"landing is not enabled: {Objection(Withheld.UNCALIBRATED)}"
        if Code.TWO_VEHICLES in wrong:
            return f"landing is not enabled: {Objection(Withheld.TWO_VEHICLES)}"
        return ""
