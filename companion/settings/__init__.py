"""Every setting with its default, unit and limits; reading, checking and printing settings files."""
