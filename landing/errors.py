"""The one root of the errors that the mathematics raises."""


class LandingError(Exception):
    """Input that the mathematics cannot work on; the text names the value, the limit and what to do."""
