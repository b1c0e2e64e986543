"""The errors a command ends with, in one line, without a traceback."""


class LandslopeError(Exception):
    """A command cannot do what was asked; the text names the value, the limit and what to do."""


class SettingsError(LandslopeError):
    """Settings that are unknown, of the wrong type or out of range; one line for each."""
