"""Whether the processor keeps up with the camera, and what would help where it does not. Pure; no clock of its own."""

from collections import deque

from companion.messages.conditions import Code, Condition, condition

WINDOW_US = 5_000_000
"""Frames are counted over this time: one late frame is no overload."""
BEGINS, ENDS = 0.1, 0.02
"""Shares of skipped frames from which the condition begins, and below which it ends."""


class Overload:
    """Takes the camera's counters; gives the condition while too many frames are skipped."""

    def __init__(self) -> None:
        self._seen: deque[tuple[int, int, int]] = deque()
        """Time (us), frames delivered and frames skipped until then."""
        self._stands = False

    def step(self, now_us: int, delivered: int, skipped: int) -> Condition | None:
        """The condition now, None while the processor keeps up or it is not known yet."""
        if self._seen and (delivered < self._seen[-1][1] or skipped < self._seen[-1][2]):
            self._seen.clear()  # another camera counts anew
        self._seen.append((now_us, delivered, skipped))
        while len(self._seen) > 1 and now_us - self._seen[1][0] >= WINDOW_US:
            self._seen.popleft()
        first_us, delivered_before, skipped_before = self._seen[0]
        span_us, done, lost = now_us - first_us, delivered - delivered_before, skipped - skipped_before
        if span_us < WINDOW_US or not done:
            return None
        share = lost / (done + lost)
        self._stands = share > (ENDS if self._stands else BEGINS)
        if not self._stands:
            return None
        rate_hz = 1e6 * done / span_us
        detail = f"{rate_hz:.0f} of {1e6 * (done + lost) / span_us:.0f} frames a second"
        return condition(Code.OVERLOADED, detail=detail)
