"""The camera's lens and its time offset, measured from pictures or a recorded flight."""
