"""A simulated multicopter and its autopilot that speaks MAVLink; ArduPilot's JSON physics interface."""
