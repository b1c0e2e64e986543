"""Flight modes by name: ArduPilot's by vehicle type, PX4's main and sub mode."""

from functools import lru_cache

from pymavlink.dialects.v20 import ardupilotmega as mavlink

_ARDUPILOT_MODES = {
    **dict.fromkeys((1, 16, 19, 20, 21, 22, 23, 24, 25, 28), "PLANE_MODE"),
    **dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35), "COPTER_MODE"),
    **dict.fromkeys((10, 11), "ROVER_MODE"),
    12: "SUB_MODE",
}
"""MAV_TYPE -> the dialect's enumeration of that vehicle's modes."""

_PX4_MAIN_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
}
_PX4_AUTO = 4
_PX4_AUTO_MODES = {
    1: "READY",
    2: "TAKEOFF",
    3: "HOLD",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOWME",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}

AUTOPILOTS = {mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "ardupilot", mavlink.MAV_AUTOPILOT_PX4: "px4"}
"""Autopilots whose modes are known by name; others are called by MAVLink's number."""


@lru_cache(maxsize=64)
def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """The mode of a HEARTBEAT by name ("GUIDED", "LAND", "HOLD"); "MODE 77" where it has none."""
    name = None
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
        name = _PX4_AUTO_MODES.get(sub) if main == _PX4_AUTO else _PX4_MAIN_MODES.get(main)
    elif autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        enumeration = _ARDUPILOT_MODES.get(vehicle_type, "")
        entry = mavlink.enums.get(enumeration, {}).get(custom_mode)
        name = entry.name.removeprefix(enumeration + "_") if entry else None
    return name or f"MODE {custom_mode}"


@lru_cache(maxsize=64)
def vehicle_type(number: int) -> str:
    """A MAV_TYPE by name ("quadrotor", "fixed_wing", "vtol_tiltrotor"); "type 77" where it has none."""
    entry = mavlink.enums["MAV_TYPE"].get(number)
    return entry.name.removeprefix("MAV_TYPE_").lower() if entry else f"type {number}"
