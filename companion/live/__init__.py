"""The daemon: camera and link into the core, messages to zenoh, recordings, commands through MAVSDK."""
