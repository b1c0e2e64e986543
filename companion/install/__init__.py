"""The systemd service put in place, upgraded or taken off, from the files that are shipped."""
