"""The wiring of landslope and its commands: settings, clock, replay, daemon, command line."""
