"""Why no landing is requested: codes with their numbers, and the one table of their words."""

from dataclasses import dataclass
from enum import StrEnum


class Withheld(StrEnum):
    """One condition that stands against a request to land. The value is the code that messages carry."""

    NOT_ENABLED = "not_enabled"
    SWITCH_OFF = "switch_off"
    SWITCH_NOT_RENEWED = "switch_not_renewed"
    MODE_NOT_CHOSEN = "mode_not_chosen"
    MODE_LOST = "mode_lost"
    STICKS_MOVED = "sticks_moved"
    TAKEN_OVER = "taken_over"
    OWN_HOLD = "own_hold"
    FAILSAFE = "failsafe"
    RADIO_LOST = "radio_lost"
    REBOOTED = "rebooted"
    ALREADY_REQUESTED = "already_requested"
    FAILSAFE_NOW = "failsafe_now"
    STATUS_NOT_READY = "status_not_ready"
    RADIO_LOST_NOW = "radio_lost_now"
    NOT_ARMED = "not_armed"
    ARMED_UNKNOWN = "armed_unknown"
    NOT_IN_AIR = "not_in_air"
    TAKING_OFF = "taking_off"
    LANDING_ALREADY = "landing_already"
    IN_AIR_UNKNOWN = "in_air_unknown"
    MODE_NOT_ALLOWED = "mode_not_allowed"
    MODE_UNKNOWN = "mode_unknown"
    VEHICLE_TYPE = "vehicle_type"
    VTOL_NOT_HOVERING = "vtol_not_hovering"
    STALE_INPUTS = "stale_inputs"
    ATTITUDE_MISSING = "attitude_missing"
    TWO_VEHICLES = "two_vehicles"
    UNCALIBRATED = "uncalibrated"
    CAMERA_FROZEN = "camera_frozen"
    IMAGE_SIZE = "image_size"
    COMMAND_UNDER_WAY = "command_under_way"


@dataclass(frozen=True, slots=True)
class Objection:
    """A code and what belongs to it: names of inputs, the vehicle's type, the mode."""

    code: Withheld
    about: tuple[str, ...] = ()

    def __str__(self) -> str:
        """The objection in words, as in ``Decision.withheld``."""
        words = WORDS[self.code]
        return f"{words}: {', '.join(self.about)}" if self.about else words


WORDS = {
    Withheld.NOT_ENABLED: "landing is not enabled",
    Withheld.SWITCH_OFF: "landing is not enabled: the pilot's switch is off",
    Withheld.SWITCH_NOT_RENEWED: "landing is not enabled: the pilot's switch must be turned off first",
    Withheld.MODE_NOT_CHOSEN: "landing is not enabled: the pilot did not choose the mode himself",
    Withheld.MODE_LOST: "landing is not enabled: no flight mode was received",
    Withheld.STICKS_MOVED: "landing is not enabled: the sticks were moved",
    Withheld.TAKEN_OVER: "landing is not enabled: the pilot took over",
    Withheld.OWN_HOLD: "landing is not enabled: hold was requested",
    Withheld.FAILSAFE: "landing is not enabled: a failsafe ended the permission",
    Withheld.RADIO_LOST: "landing is not enabled: the radio was lost",
    Withheld.REBOOTED: "landing is not enabled: the autopilot rebooted",
    Withheld.ALREADY_REQUESTED: "already requested under this permission",
    Withheld.FAILSAFE_NOW: "the autopilot is in a failsafe",
    Withheld.STATUS_NOT_READY: "the autopilot is neither standing by nor active",
    Withheld.RADIO_LOST_NOW: "the radio is lost",
    Withheld.NOT_ARMED: "vehicle not armed",
    Withheld.ARMED_UNKNOWN: "not known whether armed",
    Withheld.NOT_IN_AIR: "vehicle not in the air",
    Withheld.TAKING_OFF: "vehicle taking off",
    Withheld.LANDING_ALREADY: "vehicle landing already",
    Withheld.IN_AIR_UNKNOWN: "not known whether in the air",
    Withheld.MODE_NOT_ALLOWED: "flight mode not allowed",
    Withheld.MODE_UNKNOWN: "flight mode unknown",
    Withheld.VEHICLE_TYPE: "no multicopter or helicopter",
    Withheld.VTOL_NOT_HOVERING: "the VTOL is not known to hover",
    Withheld.STALE_INPUTS: "stale inputs",
    Withheld.ATTITUDE_MISSING: "the frames have no attitude",
    Withheld.TWO_VEHICLES: "two vehicles on the link, set vehicle.system_id",
    Withheld.UNCALIBRATED: "the camera is not calibrated",
    Withheld.CAMERA_FROZEN: "the picture stands still while the vehicle turns",
    Withheld.IMAGE_SIZE: "the pictures have another size than the calibration",
    Withheld.COMMAND_UNDER_WAY: "a command is under way",
}
"""Code -> words; the only place where they are made."""
