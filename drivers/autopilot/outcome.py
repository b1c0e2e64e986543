"""How a command to the autopilot ended."""

from dataclasses import dataclass

NO_ANSWER = "NO_ANSWER"
NO_AUTOPILOT = "NO_AUTOPILOT"
ENDED = "ENDED"
"""The vehicle was taken over, or flies another mode than the order was given in: nothing was sent."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a command ended.

    ``result`` is MAVLink's name of the last answer ("ACCEPTED", "DENIED", "TEMPORARILY_REJECTED", ...), or
    NO_ANSWER, NO_AUTOPILOT; ``answers`` are all that came, in order; ``mavsdk`` is what MAVSDK made of it.
    """

    result: str
    answers: tuple[str, ...]
    mavsdk: str
