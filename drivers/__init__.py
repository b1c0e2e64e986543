"""Everything of landslope that touches the outside: cameras, MAVLink, MAVSDK, zenoh, files, the service manager."""
