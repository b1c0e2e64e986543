"""Watches the surface while the autopilot lands at our request, and reports one that turns out unfit.

In: the published ``Decision`` and ``Estimate`` messages and the ground map. Out: the event ``surface_unfit``, at most
one per landing, and whether hold is to be commanded (``landing.on_unfit``). Times are microseconds of the messages,
heights metres.
"""

from dataclasses import dataclass

from companion.core.command import UNDER_WAY, WORDS
from companion.messages.messages import Decision, Estimate, Event, Message
from companion.settings.settings import LandingSettings
from landing.decision.decision import GroundBelow, against_touchdown
from landing.ground.spots import GroundCode
from landing.reasons import Code, Status, in_words

LANDING = frozenset(WORDS[code] for code in UNDER_WAY)
"""Values of ``Decision.command`` while a landing is in progress."""

MEASURED = frozenset({Code.TOO_STEEP, Code.TOO_ROUGH, Code.OBSTACLE_POINTS})
"""Reasons that are measurements of the whole view. That too little of it is seen is normal near the ground, and no
reason to interrupt a landing."""


@dataclass(frozen=True, slots=True)
class Watched:
    """The event to publish, and whether the autopilot is to be commanded to hold."""

    event: Event
    hold: bool


class LandingWatch:
    """``feed`` takes the pipeline's messages in order.

    An abort needs as much evidence as a request: evidence in every frame of ``dwell_s``. While the ground map has a
    scale, evidence is a hazard among the discs where the vehicle lands; noise of the whole view, ground beside these
    discs and unknown ground are none. Without a scale, evidence is a certain reason of the whole view. Nothing is
    reported below ``landing.unfit_min_height_m`` (or, without a height, ``unfit_min_contact_s``): there an abort is
    worse than the landing.
    """

    def __init__(self, settings: LandingSettings, dwell_s: float, ground: GroundBelow | None = None) -> None:
        """``ground`` is read at each estimate; it then is of that estimate's frame or a newer one."""
        self._s = settings
        self._dwell_us = round(dwell_s * 1e6)
        self._ground = ground
        self._landing = self._unfit = False
        self._since_us: int | None = None
        self._spoken = False

    def feed(self, message: Message) -> Watched | None:
        """Take one message; returns what to publish and do, usually None."""
        if isinstance(message, Decision):
            self._take(message)
        elif isinstance(message, Estimate) and self._landing and not self._spoken:
            return self._see(message)
        return None

    def _take(self, decision: Decision) -> None:
        """A decision is published at every change of the verdict, so the one taken last holds until the next."""
        self._landing = decision.command in LANDING
        self._unfit = decision.verdict == "unfit" and bool(MEASURED.intersection(decision.reason_codes))
        if not self._landing:
            self._since_us, self._spoken = None, False

    def _see(self, estimate: Estimate) -> Watched | None:
        evidence = self._evidence(estimate)
        if not evidence:
            self._since_us = None
            return None
        if self._since_us is None:
            self._since_us = estimate.time_unix_us
        if estimate.time_unix_us - self._since_us < self._dwell_us or not self._in_time(estimate):
            return None
        self._spoken = True
        return self._words(estimate, evidence)

    def _evidence(self, estimate: Estimate) -> tuple[str, ...]:
        """Reasons in words, from this frame alone, that the ground where the vehicle lands is unfit; empty: none."""
        if estimate.status != Status.OK:
            # the map still has older measurements, but this frame has none
            return ()
        if self._ground is not None:
            below, way = self._ground.under_way()
            if GroundCode.NO_METRES not in below.reasons:
                found = against_touchdown(below, way, all_known=False)
                return in_words(reason for reason in found if reason.code is Code.TOUCHDOWN_HAZARD)
        if self._unfit and MEASURED.intersection(estimate.against_flat_codes):
            return estimate.against_flat
        return ()

    def _words(self, estimate: Estimate, evidence: tuple[str, ...]) -> Watched:
        hold = self._s.on_unfit == "hold"
        reasons = ", ".join(evidence)
        return Watched(
            Event(
                event="surface_unfit",
                frame=estimate.frame,
                time_unix_us=estimate.time_unix_us,
                severity="error",
                text=f"landing on an unfit surface: {reasons}" + ("; hold is asked for" if hold else ""),
                details={"hold": hold, "reasons": list(evidence)},
            ),
            hold,
        )

    def _in_time(self, estimate: Estimate) -> bool:
        if estimate.height_m is not None:
            return estimate.height_m > self._s.unfit_min_height_m
        contact_s = estimate.time_to_contact_s
        # Not approaching: no contact is near.
        return contact_s is None or contact_s < 0 or contact_s > self._s.unfit_min_contact_s
