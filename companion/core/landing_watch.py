"""After the request the surface is watched on: what if it turns out unfit while there is still time?"""

from dataclasses import dataclass

from companion.messages.messages import Decision, Estimate, Event, Message
from companion.settings.settings import LandingSettings

LANDING = frozenset({"requested", "in progress", "accepted", "landing"})


@dataclass(frozen=True, slots=True)
class Watched:
    """What the watch says: an event, and whether the autopilot is to be asked for hold."""

    event: Event
    hold: bool


class LandingWatch:
    """Pure: fed with the pipeline's messages. Speaks once a landing, and only above the height (or, where it is not
    known, the time to contact) below which breaking off would be worse than going on."""

    def __init__(self, settings: LandingSettings) -> None:
        self._s = settings
        self._estimate: Estimate | None = None
        self._spoken = False

    def feed(self, message: Message) -> Watched | None:
        """Take one message; what is to be said and done, if anything."""
        if isinstance(message, Estimate):
            self._estimate = message
        if not isinstance(message, Decision):
            return None
        if message.command not in LANDING:
            self._spoken = False
            return None
        if self._spoken or message.verdict != "unfit" or not self._in_time():
            return None
        self._spoken = True
        hold = self._s.on_unfit == "hold"
        reasons = ", ".join(message.reasons)
        return Watched(
            Event(
                event="surface_unfit",
                frame=message.frame,
                time_unix_us=message.time_unix_us,
                severity="error",
                text=f"landing on an unfit surface: {reasons}" + ("; hold is asked for" if hold else ""),
                details={"hold": hold, "reasons": list(message.reasons)},
            ),
            hold,
        )

    def _in_time(self) -> bool:
        estimate = self._estimate
        if estimate is None:
            return False
        if estimate.height_m is not None:
            return estimate.height_m > self._s.unfit_min_height_m
        contact_s = estimate.time_to_contact_s
        # Not approaching: no contact is near.
        return contact_s is None or contact_s < 0 or contact_s > self._s.unfit_min_contact_s
