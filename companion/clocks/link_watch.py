"""How late the telemetry comes over this link, said once and then rarely: a burst is no change of the clocks."""

REPORT_AFTER_US = 1_000_000
REPORT_AGAIN_US = 30_000_000

SPELL_US = 200_000
"""Late messages closer together than this are one spell."""


class LinkWatch:
    """Feed it every message's lateness against the relation of the clocks; all times in microseconds."""

    def __init__(self, late_min_s: float) -> None:
        """``late_min_s``: what is later than this counts."""
        self._late_min_us = late_min_s * 1e6
        self._worst_us, self._spells = 0.0, 0
        self._first_us: int | None = None
        self._last_us: int | None = None
        self._reported_us: int | None = None

    def feed(self, late_us: float, now_us: int) -> dict[str, float] | None:
        """Details of an event, where one is due: ``late_s``, the latest message, and the number of ``spells``."""
        if late_us > self._late_min_us:
            if self._last_us is None or now_us - self._last_us > SPELL_US:
                self._spells += 1
            self._worst_us = max(self._worst_us, late_us)
            self._first_us = now_us if self._first_us is None else self._first_us
            self._last_us = now_us
        if self._first_us is None or now_us - self._first_us < REPORT_AFTER_US:
            return None
        if self._reported_us is not None and now_us - self._reported_us < REPORT_AGAIN_US:
            return None
        details = {"late_s": round(self._worst_us * 1e-6, 3), "spells": self._spells}
        self._reported_us, self._first_us = now_us, None
        self._worst_us, self._spells = 0.0, 0
        return details
