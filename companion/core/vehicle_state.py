"""What the autopilot says of itself: mode, arming, failsafes, radio, kind of vehicle. Time is given, none is read."""

from drivers.samples import CurrentMode, Heartbeat, LandedState, Sample, StatusText, SystemStatus

STANDBY, ACTIVE, CRITICAL, EMERGENCY, FLIGHT_TERMINATION = 3, 4, 5, 6, 8
"""Of MAV_STATE."""
FAILSAFE_STATUS = frozenset({CRITICAL, EMERGENCY, FLIGHT_TERMINATION})
READY_STATUS = frozenset({STANDBY, ACTIVE})

MULTICOPTERS = frozenset(
    {
        "quadrotor",
        "coaxial",
        "helicopter",
        "hexarotor",
        "octorotor",
        "tricopter",
        "dodecarotor",
        "decarotor",
        "generic_multirotor",
    }
)
"""Of MAV_TYPE."""
VTOL = "vtol_"
"""How the names of MAV_TYPE's VTOLs begin."""

CONFIRM_US = 1_500_000
"""A failsafe reported by a text is over when a heartbeat this much later says active: PX4's come once a second."""

RADIO_LOST_TEXTS = ("radio failsafe", "manual control lost", "rc lost", "rc signal lost", "radio lost")
OVER_TEXTS = ("cleared", "regained", "restored", "disabled", "off")
TAKE_OVER_TEXTS = ("pilot took over",)
"""Beginnings and parts of ArduCopter's and PX4's texts, in small letters."""


class VehicleState:
    """The newest of everything; ``forget`` at a reboot."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Nothing is known any more."""
        self.heartbeat: Heartbeat | None = None
        self.landed: LandedState | None = None
        self.mode: str | None = None
        self.intended = True
        """False while the autopilot is known to fly another mode than it was asked for."""
        self.pilot_took_over = False
        """Whether the last sample was the autopilot's text that the pilot moved the sticks."""
        self._radio: SystemStatus | None = None
        self._radio_us = 0
        self._radio_was_there = False
        self._radio_text_us: int | None = None
        self._failsafe_text_us: int | None = None

    def feed(self, sample: Sample, now_us: int) -> None:
        """Take one sample."""
        self.pilot_took_over = False
        if isinstance(sample, Heartbeat):
            self.heartbeat = sample
            if sample.mode != self.mode:
                self.mode, self.intended = sample.mode, True
            calm = sample.system_status in READY_STATUS
            if calm and self._failsafe_text_us is not None and now_us - self._failsafe_text_us > CONFIRM_US:
                self._failsafe_text_us = None
        elif isinstance(sample, CurrentMode):
            self.mode = sample.mode
            self.intended = sample.intended in ("", sample.mode)
        elif isinstance(sample, LandedState):
            self.landed = sample
        elif isinstance(sample, SystemStatus):
            self._system_status(sample, now_us)
        elif isinstance(sample, StatusText):
            self._text(sample.text.lower(), now_us)

    @property
    def armed(self) -> bool | None:
        """None before the first heartbeat."""
        return None if self.heartbeat is None else self.heartbeat.armed

    @property
    def failsafe(self) -> bool | None:
        """Whether the autopilot is in a failsafe, by HEARTBEAT's status or by its text; None before a heartbeat."""
        if self._failsafe_text_us is not None:
            return True
        return None if self.heartbeat is None else self.heartbeat.system_status in FAILSAFE_STATUS

    @property
    def ready(self) -> bool | None:
        """Whether it stands by or is active (not booting, calibrating or powering off)."""
        return None if self.heartbeat is None else self.heartbeat.system_status in READY_STATUS

    @property
    def radio_lost(self) -> bool:
        """Whether a radio that is there is known to be lost; silence of RC_CHANNELS is not looked at here."""
        r = self._radio
        if self._radio_text_us is not None:
            return True
        if r is None:
            return False
        there = r.radio_present and r.radio_enabled
        return not r.radio_healthy if there else self._radio_was_there

    def radio_age_s(self, now_us: int) -> float | None:
        """Age of the newest SYS_STATUS; None when none came."""
        return None if self._radio is None else (now_us - self._radio_us) * 1e-6

    @property
    def kind(self) -> str | None:
        """As ``Gate.vehicle``: "multicopter", "vtol_hovering", "vtol" or MAV_TYPE's name; None before a heartbeat."""
        if self.heartbeat is None:
            return None
        name = self.heartbeat.vehicle_type
        if name in MULTICOPTERS:
            return "multicopter"
        if name.startswith(VTOL):
            hovers = self.landed is not None and self.landed.vtol_state == "multicopter"
            return "vtol_hovering" if hovers else "vtol"
        return name

    def _system_status(self, sample: SystemStatus, now_us: int) -> None:
        self._radio, self._radio_us = sample, now_us
        there = sample.radio_present and sample.radio_enabled
        if there and sample.radio_healthy:
            self._radio_was_there = True
            if self._radio_text_us is not None and now_us - self._radio_text_us > CONFIRM_US:
                self._radio_text_us = None

    def _text(self, text: str, now_us: int) -> None:
        self.pilot_took_over = any(part in text for part in TAKE_OVER_TEXTS)
        over = any(part in text.split() for part in OVER_TEXTS)
        if any(part in text for part in RADIO_LOST_TEXTS) or text.startswith("manual control"):
            self._radio_text_us = None if over else now_us
        # ArduCopter's HEARTBEAT stays ACTIVE when its fence is breached; "PrecLand: Failsafe Measures" only says that a
        # landing begins without a target
        if ("failsafe" in text and not text.startswith("precland")) or ("fence" in text and "breach" in text):
            self._failsafe_text_us = None if over else now_us
