"""The errors a command ends with, in one line, without a traceback."""

from drivers.secrets import masked


class LandslopeError(Exception):
    """A command cannot do what was asked; the text names the value, the limit and what to do, but no secret."""

    def __init__(self, text: object = "") -> None:
        super().__init__(masked(str(text)))


class SettingsError(LandslopeError):
    """Settings that are unknown, of the wrong type or out of range; one line for each."""
