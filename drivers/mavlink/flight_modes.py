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
_PX4_POSITION = 3
_PX4_POSITION_MODES = {1: "ORBIT", 2: "POSITION_SLOW"}
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
    **{10 + number: f"EXTERNAL{number}" for number in range(1, 9)},
}

_PX4_STATES = {
    0: "MANUAL",
    1: "ALTCTL",
    2: "POSCTL",
    3: "MISSION",
    4: "HOLD",
    5: "RTL",
    6: "POSITION_SLOW",
    10: "ACRO",
    12: "LAND",  # descends without a position; HEARTBEAT says LAND
    13: "TERMINATION",
    14: "OFFBOARD",
    15: "STABILIZED",
    17: "TAKEOFF",
    18: "LAND",
    19: "FOLLOWME",
    20: "PRECLAND",
    21: "ORBIT",
    22: "VTOL_TAKEOFF",
    **{22 + number: f"EXTERNAL{number}" for number in range(1, 9)},
}
"""vehicle_status.nav_state of PX4's logs."""

ALIASES = {
    "Position": "POSCTL",
    "Altitude": "ALTCTL",
    "Stabilized": "STABILIZED",
    "Return": "RTL",
    "Return to Launch": "RTL",
    "Follow Me": "FOLLOWME",
    "Precision Land": "PRECLAND",
    "Position Slow": "POSITION_SLOW",
    "Altitude Hold": "ALT_HOLD",
    "Position Hold": "POSHOLD",
    "Guided No GPS": "GUIDED_NOGPS",
    "Auto RTL": "AUTO_RTL",
}
"""What QGroundControl and Mission Planner call modes -> our name, where they differ by more than spelling."""

AUTOPILOTS = {mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: "ardupilot", mavlink.MAV_AUTOPILOT_PX4: "px4"}
"""Autopilots whose modes are known by name; others are called by MAVLink's number."""


@lru_cache(maxsize=64)
def mode_name(autopilot: int, vehicle_type: int, custom_mode: int) -> str:
    """The mode of a HEARTBEAT by name ("GUIDED", "LAND", "HOLD"); "MODE 77" where it has none."""
    name = None
    if autopilot == mavlink.MAV_AUTOPILOT_PX4:
        main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
        if main == _PX4_AUTO:
            name = _PX4_AUTO_MODES.get(sub)
        elif main == _PX4_POSITION and sub:
            name = _PX4_POSITION_MODES.get(sub)
        else:
            name = _PX4_MAIN_MODES.get(main)
    elif autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        enumeration = _ARDUPILOT_MODES.get(vehicle_type, "")
        entry = mavlink.enums.get(enumeration, {}).get(custom_mode)
        name = entry.name.removeprefix(enumeration + "_") if entry else None
    return name or f"MODE {custom_mode}"


def px4_mode_of_state(nav_state: int) -> str:
    """The mode of a ``nav_state`` in PX4's log, by the name that its HEARTBEAT has."""
    return _PX4_STATES.get(nav_state, f"STATE {nav_state}")


@lru_cache(maxsize=1)
def known_modes() -> frozenset[str]:
    """Every mode that has a name here, of every autopilot and vehicle."""
    enumerations = set(_ARDUPILOT_MODES.values())
    ardupilot = {
        entry.name.removeprefix(enumeration + "_")
        for enumeration in enumerations
        for entry in mavlink.enums[enumeration].values()
        if not entry.name.endswith("ENUM_END")
    }
    px4 = (_PX4_MAIN_MODES, _PX4_POSITION_MODES, _PX4_AUTO_MODES)
    return frozenset(ardupilot.union(*(table.values() for table in px4)))


def canonical_mode(name: str) -> str | None:
    """A mode by our name, from any spelling of it ("Position", "alt hold", "AltHold"); None for no mode."""
    spelled = {_letters(known): known for known in known_modes()}
    spelled |= {_letters(alias): known for alias, known in ALIASES.items()}
    return spelled.get(_letters(name))


def _letters(name: str) -> str:
    return "".join(filter(str.isalnum, name)).lower()


@lru_cache(maxsize=64)
def vehicle_type(number: int) -> str:
    """A MAV_TYPE by name ("quadrotor", "fixed_wing", "vtol_tiltrotor"); "type 77" where it has none."""
    entry = mavlink.enums["MAV_TYPE"].get(number)
    return entry.name.removeprefix("MAV_TYPE_").lower() if entry else f"type {number}"
