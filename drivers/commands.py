"""MAVLink's commands by number, and the flight modes that they lead to."""

NAV_LAND = 21
"""MAV_CMD_NAV_LAND."""
DO_SET_MODE = 176
"""MAV_CMD_DO_SET_MODE, by which MAVSDK asks for hold."""

LAND_MODES = frozenset({"LAND", "AUTO.LAND", "AUTO_LAND", "QLAND", "PRECLAND"})
"""The autopilot is landing."""
HOLD_MODES = frozenset({"HOLD", "BRAKE", "LOITER"})
"""Where hold and the end of setpoints lead: PX4's HOLD, ArduCopter's BRAKE or LOITER (measured with MAVSDK 4.1)."""
CONTROL_MODES = frozenset({"GUIDED", "OFFBOARD"})
"""The autopilot follows setpoints: ArduCopter's and PX4's."""
