"""The one root of the errors that drivers raise."""

from drivers.secrets import masked


class DriverError(Exception):
    """Something outside (file, device, link) cannot be used; the text names it, and what to do, but no secret."""

    def __init__(self, text: object = "", remedy: str = "") -> None:
        super().__init__(masked(str(text)))
        self.remedy = remedy
        """What to do, where a caller would otherwise guess."""
