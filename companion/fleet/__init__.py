"""Many vehicles under one zenoh router: its configuration, and losses and delay measured."""
