"""After the request the surface is watched on: what if it turns out unfit while there is still time?"""

from dataclasses import dataclass

from companion.core.command import UNDER_WAY, WORDS
from companion.messages.messages import Decision, Estimate, Event, Message
from companion.settings.settings import LandingSettings
from landing.reasons import Code

LANDING = frozenset(WORDS[code] for code in UNDER_WAY)

MEASURED = frozenset({Code.TOO_STEEP, Code.TOO_ROUGH, Code.OBSTACLE_POINTS})
"""Reasons that say what the ground is. That too little of it is seen is natural near the ground, and no reason to
break off."""


@dataclass(frozen=True, slots=True)
class Watched:
    """What the watch says: an event, and whether the autopilot is to be asked for hold."""

    event: Event
    hold: bool


class LandingWatch:
    """Pure: fed with the pipeline's messages. An abort needs what a request needs: evidence in every frame of
    ``dwell_s``. Speaks once a landing, and only above the height (or, where it is not known, the time to contact)
    below which breaking off would be worse than going on."""

    def __init__(self, settings: LandingSettings, dwell_s: float) -> None:
        self._s = settings
        self._dwell_us = round(dwell_s * 1e6)
        self._decision: Decision | None = None
        self._since_us: int | None = None
        self._spoken = False

    def feed(self, message: Message) -> Watched | None:
        """Take one message; what is to be said and done, if anything."""
        if isinstance(message, Decision):
            self._take(message)
        elif isinstance(message, Estimate) and self._due(message):
            self._spoken = True
            return self._words(message)
        return None

    def _take(self, decision: Decision) -> None:
        """A decision is told at every change of the verdict, so the one taken last holds until the next."""
        self._decision = decision
        landing = decision.command in LANDING
        self._spoken = self._spoken and landing
        if not landing or decision.verdict != "unfit" or not MEASURED.intersection(decision.reason_codes):
            self._since_us = None
        elif self._since_us is None:
            self._since_us = decision.time_unix_us

    def _due(self, estimate: Estimate) -> bool:
        if self._spoken or self._since_us is None:
            return False
        if not MEASURED.intersection(estimate.against_flat_codes):
            self._since_us = None
            return False
        return estimate.time_unix_us - self._since_us >= self._dwell_us and self._in_time(estimate)

    def _words(self, estimate: Estimate) -> Watched:
        hold = self._s.on_unfit == "hold"
        reasons = ", ".join(estimate.against_flat)
        return Watched(
            Event(
                event="surface_unfit",
                frame=estimate.frame,
                time_unix_us=estimate.time_unix_us,
                severity="error",
                text=f"landing on an unfit surface: {reasons}" + ("; hold is asked for" if hold else ""),
                details={"hold": hold, "reasons": list(estimate.against_flat)},
            ),
            hold,
        )

    def _in_time(self, estimate: Estimate) -> bool:
        if estimate.height_m is not None:
            return estimate.height_m > self._s.unfit_min_height_m
        contact_s = estimate.time_to_contact_s
        # Not approaching: no contact is near.
        return contact_s is None or contact_s < 0 or contact_s > self._s.unfit_min_contact_s
