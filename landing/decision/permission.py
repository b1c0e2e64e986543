"""The permission to land, and the gate before the command. Pure: states and transitions, no clock, no samples.

The pilot gives a permission by turning his switch on: a radio channel, a flight mode, or both. The states::

    LOCKED --switch seen off--> OFF --switch turned on by the pilot--> STANDING --request--> USED
    STANDING, USED --switch turned off--> OFF
    STANDING, USED --takeover, sticks, failsafe, radio lost, reboot, hold--> LOCKED
    STANDING --mode left or radio silent, not by the pilot--> LOCKED
    OFF --switch turned on in a failsafe, or not by the pilot--> LOCKED

A mode that a command of ours or the autopilot caused is neither on nor off: it is UNCLEAR, so it never renews a
permission. Drawn with its reasons in docs/permission.md.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from landing.decision.withheld import Objection, Withheld

AUTOMATIC_MODES = frozenset(
    {
        "LAND", "AUTO.LAND", "AUTO_LAND", "QLAND", "PRECLAND", "RTL", "QRTL", "SMART_RTL", "AUTO_RTL", "BRAKE",
        "TAKEOFF", "VTOL_TAKEOFF", "TERMINATION", "READY", "THROW", "FLIP", "AVOID_ADSB", "AUTOROTATE",
    }
)  # fmt: skip
"""Modes that an autopilot enters or leaves by itself (PX4: a takeoff ends in the mode before, LAND at disarming)."""

ENDS_BY_ITSELF = frozenset(
    (before, after) for before in ("MISSION", "FOLLOWME", "ORBIT", "VTOL_TAKEOFF") for after in ("HOLD",)
)
"""(mode, mode) that PX4 changes between without the pilot: a mission ends in HOLD."""

HOLD_MODES = frozenset({"HOLD", "BRAKE", "LOITER", "POSHOLD"})
"""Modes that our own request to hold leads to."""


class Position(StrEnum):
    """Of a switch. UNCLEAR: unknown, or not the pilot's doing."""

    OFF = "off"
    ON = "on"
    UNCLEAR = "unclear"


class Phase(StrEnum):
    """Of the permission."""

    LOCKED = "locked"
    OFF = "off"
    STANDING = "standing"
    USED = "used"


@dataclass(frozen=True, slots=True)
class Switch:
    """What gives the permission. Without radio and modes it is given by hand (``landing.enabled``)."""

    radio: bool = False
    modes: frozenset[str] = frozenset()
    stick_limit_us: int = 300

    @property
    def by_hand(self) -> bool:
        """Whether no switch of the pilot's is configured."""
        return not self.radio and not self.modes


@dataclass(frozen=True, slots=True)
class Seen:
    """One moment as the permission sees it.

    ``hand``, ``radio``: positions; ``mode`` by name, None while unknown; ``intended`` False: the autopilot flies
    another mode than the pilot asked for (PX4's CURRENT_MODE); ``failsafe`` None while unknown; ``radio_lost``: the
    radio is known to be lost; ``sticks``: roll, pitch, throttle, yaw in us, 0 where there is none.
    """

    hand: Position = Position.OFF
    radio: Position = Position.UNCLEAR
    mode: str | None = None
    intended: bool = True
    failsafe: bool | None = False
    radio_lost: bool = False
    armed: bool | None = True
    sticks: tuple[int, ...] = ()


class Permission:
    """The state machine: ``step`` at every change, ``use`` when a request goes out, ``end`` at what ends it."""

    def __init__(self, switch: Switch) -> None:
        self._switch = switch
        self.phase = Phase.OFF if switch.by_hand else Phase.LOCKED
        self.cause = Withheld.SWITCH_NOT_RENEWED
        """Why it is locked; of use while ``phase`` is LOCKED."""
        self.used = False
        """Whether a request went out under this permission, also when it has ended since."""
        self._hand = Position.OFF
        self._radio = self._by_mode = Position.ON
        self._mode: str | None = None
        self._not_chosen = True
        self._own_hold = False
        self._sticks: tuple[int, ...] = ()
        self._sticks_at_start: tuple[int, ...] = ()

    @property
    def objection(self) -> Objection | None:
        """What stands against a request as far as the permission goes; None while it stands."""
        if self.phase is Phase.STANDING:
            return None
        if self.phase is Phase.USED:
            return Objection(Withheld.ALREADY_REQUESTED)
        if self.phase is Phase.LOCKED:
            return Objection(self.cause)
        return Objection(Withheld.NOT_ENABLED if self._switch.by_hand else Withheld.SWITCH_OFF)

    def step(self, seen: Seen) -> None:
        """Take the present moment."""
        before = (self._hand, self._radio, self._by_mode)
        self._hand = seen.hand if self._switch.by_hand else Position.ON
        self._radio = self._radio_position(seen)
        self._by_mode = self._mode_position(seen)
        now = (self._hand, self._radio, self._by_mode)
        self._take_sticks(seen.sticks)
        ending = self._ending(seen)
        if Position.OFF in now:
            self.phase, self.used = Phase.OFF, False
        elif ending is not None:
            # also what is turned on meanwhile: a permission never begins in a failsafe
            if self.phase is not Phase.LOCKED and (
                self.phase is not Phase.OFF or Position.UNCLEAR not in now
            ):
                self._lock(ending)
        elif Position.UNCLEAR in now:
            if self.phase is Phase.STANDING:
                self._lock(Withheld.MODE_NOT_CHOSEN if seen.mode else Withheld.MODE_LOST)
        elif self.phase is Phase.OFF:
            turned = (b for b, n in zip(before, now, strict=True) if b is not n)
            if all(b is Position.OFF for b in turned):
                self.phase = Phase.STANDING
                self._sticks_at_start = self._sticks
            else:
                self._lock(Withheld.MODE_NOT_CHOSEN)

    def use(self) -> None:
        """A request goes out: the only one under this permission."""
        self.phase, self.used = Phase.USED, True

    def end(self, cause: Withheld) -> None:
        """Something ended it: a takeover, a reboot, our own hold."""
        if cause is Withheld.OWN_HOLD:
            self._own_hold = True
        if self.phase in (Phase.STANDING, Phase.USED):
            self._lock(cause)

    def _lock(self, cause: Withheld) -> None:
        self.phase, self.cause = Phase.LOCKED, cause

    def _ending(self, seen: Seen) -> Withheld | None:
        """What ends a permission that stands, and keeps one from beginning."""
        # given by hand it cannot be renewed by hand in flight: on the ground a failsafe withholds only
        if seen.failsafe and not (self._switch.by_hand and seen.armed is False):
            return Withheld.FAILSAFE
        if seen.radio_lost or (self._switch.radio and seen.radio is Position.UNCLEAR):
            return Withheld.RADIO_LOST
        if self.phase in (Phase.STANDING, Phase.USED) and self._sticks_moved():
            return Withheld.STICKS_MOVED
        return None

    def _radio_position(self, seen: Seen) -> Position:
        if not self._switch.radio:
            return Position.ON
        # a receiver without a radio goes on with held values
        return Position.UNCLEAR if seen.radio_lost else seen.radio

    def _mode_position(self, seen: Seen) -> Position:
        if not self._switch.modes:
            return Position.ON
        if seen.mode is None:
            return Position.UNCLEAR
        if seen.mode != self._mode:
            ours = self._own_hold and seen.mode in HOLD_MODES
            by_itself = seen.mode in AUTOMATIC_MODES or (self._mode, seen.mode) in ENDS_BY_ITSELF
            self._not_chosen = ours or by_itself or seen.failsafe is not False or not seen.intended
            self._own_hold = False
            self._mode = seen.mode
        if self._not_chosen:
            return Position.UNCLEAR
        if seen.mode in self._switch.modes:
            return Position.ON
        return Position.UNCLEAR if seen.failsafe is not False or not seen.intended else Position.OFF

    def _take_sticks(self, sticks: tuple[int, ...]) -> None:
        """A stick that is first seen after the permission began is compared with where it was then."""
        self._sticks = sticks or self._sticks
        start = self._sticks_at_start
        self._sticks_at_start = tuple(
            (start[i] if i < len(start) else 0) or now for i, now in enumerate(self._sticks)
        )

    def _sticks_moved(self) -> bool:
        limit = 0 if self._switch.by_hand else self._switch.stick_limit_us
        pairs = zip(self._sticks, self._sticks_at_start, strict=True)
        return limit > 0 and any(a and abs(a - b) >= limit for a, b in pairs)


@dataclass(frozen=True, slots=True)
class Gate:
    """What must hold beside the permission; None is unknown, which counts against landing.

    ``landed``: "in_air", "on_ground", "takeoff", "landing", None; ``status``: MAV_STATE of the HEARTBEAT;
    ``vehicle``: "multicopter", "vtol_hovering", "vtol", or another type by name; ``allowed_vehicles`` widen.
    """

    armed: bool | None
    landed: str | None
    mode_allowed: bool | None
    failsafe: bool | None = False
    ready: bool | None = True
    radio_lost: bool = False
    vehicle: str | None = "multicopter"
    allowed_vehicles: frozenset[str] = frozenset()
    stale: tuple[str, ...] = ()
    attitude_missing: bool = False
    two_vehicles: bool = False
    calibrated: bool = True
    camera_frozen: bool = False
    image_size_wrong: bool = False
    command_busy: bool = False


LANDED_WORDS: dict[str | None, Withheld] = {
    "on_ground": Withheld.NOT_IN_AIR,
    "takeoff": Withheld.TAKING_OFF,
    "landing": Withheld.LANDING_ALREADY,
}
HOVERING = frozenset({"multicopter", "vtol_hovering"})


def objections(permission: Permission, gate: Gate) -> tuple[Objection, ...]:
    """Everything that stands against a request now, the permission first; empty when one may go out."""
    g = gate
    found: list[Objection | None] = [permission.objection]
    found.append(_if(g.failsafe is True, Withheld.FAILSAFE_NOW))
    found.append(_if(g.failsafe is not True and g.ready is False, Withheld.STATUS_NOT_READY))
    found.append(_if(g.radio_lost, Withheld.RADIO_LOST_NOW))
    found.append(_known(g.armed, Withheld.NOT_ARMED, Withheld.ARMED_UNKNOWN))
    if g.landed != "in_air":
        found.append(Objection(LANDED_WORDS.get(g.landed, Withheld.IN_AIR_UNKNOWN)))
    found.append(_known(g.mode_allowed, Withheld.MODE_NOT_ALLOWED, Withheld.MODE_UNKNOWN))
    if g.vehicle is not None and g.vehicle not in HOVERING | g.allowed_vehicles:
        code = Withheld.VTOL_NOT_HOVERING if g.vehicle == "vtol" else Withheld.VEHICLE_TYPE
        found.append(Objection(code, () if g.vehicle == "vtol" else (g.vehicle,)))
    found.append(Objection(Withheld.STALE_INPUTS, g.stale) if g.stale else None)
    found.append(_if(g.attitude_missing, Withheld.ATTITUDE_MISSING))
    found.append(_if(g.two_vehicles, Withheld.TWO_VEHICLES))
    found.append(_if(not g.calibrated, Withheld.UNCALIBRATED))
    found.append(_if(g.camera_frozen, Withheld.CAMERA_FROZEN))
    found.append(_if(g.image_size_wrong, Withheld.IMAGE_SIZE))
    found.append(_if(g.command_busy, Withheld.COMMAND_UNDER_WAY))
    return tuple(_present(found))


def _if(holds: bool, code: Withheld) -> Objection | None:
    return Objection(code) if holds else None


def _known(value: bool | None, no: Withheld, unknown: Withheld) -> Objection | None:
    return None if value is True else Objection(no if value is False else unknown)


def _present(found: Iterable[Objection | None]) -> Iterable[Objection]:
    return (objection for objection in found if objection is not None)
