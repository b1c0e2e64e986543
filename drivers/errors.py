"""The one root of the errors that drivers raise."""


class DriverError(Exception):
    """Something outside (file, device, link) cannot be used; the text names it, and what to do."""
