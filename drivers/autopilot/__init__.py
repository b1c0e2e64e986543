"""Orders to the autopilot through MAVSDK or by message of our own, and its parameters read."""
