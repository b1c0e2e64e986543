"""The MAVLink link: ports, framing, signing, rates, forwarding, telemetry samples, and MAVSDK on top."""
