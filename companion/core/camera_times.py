"""Lateness of the frames and rolling-shutter readout, as estimated, and when an event reports them."""

import math

from companion.messages.events import event
from companion.messages.messages import Event
from landing.plane.time_offset import TimeOffsetFilter

LATE_REPORTED_S, LATE_SIGMAS = 0.005, 4.0
"""A lateness of the frames that an event reports."""
READOUT_REPORTED_S, READOUT_STD_S = 0.002, 0.001
"""A readout of the rows that an event reports, and how well it has to be known."""
SETTLED_S, SETTLED_WITHIN_S = 5.0, 0.001
"""A readout has settled when it has not changed by more than this within so long."""


class CameraTimes:
    """Watches the lateness of the frames and the readout of the rows."""

    def __init__(self, found: TimeOffsetFilter, set_offset_s: float) -> None:
        self.found, self._set_offset_s = found, set_offset_s
        self._readout_known = found.readout_std_s == 0
        self._late_reported_s = self._readout_reported_s = 0.0
        self._last_s = self._since_s = -math.inf
        self._steady_s = math.inf

    @property
    def readout(self) -> tuple[float | None, float | None]:
        """The readout and its standard deviation, None while it has not settled or where it is set."""
        if self._readout_known or not self._last_s - self._since_s >= SETTLED_S:  # NaN before the first step
            return None, None
        return self.found.readout_s, self.found.readout_std_s

    @property
    def readout_unknown(self) -> bool:
        """Whether the readout is neither set nor found: slopes are doubtful while the vehicle turns."""
        return not self._readout_known and self.readout[0] is None

    def step(
        self, now_s: float, frame: int | None, time_unix_us: int, contradicted: bool = False
    ) -> list[Event]:
        """What is to be reported now; no lateness while pictures and vehicle contradict each other."""
        out = [] if contradicted and not self.found.at_bound else self._late(frame, time_unix_us)
        if self._readout_known:
            return out
        found = self.found
        if found.readout_std_s > READOUT_STD_S or abs(found.readout_s - self._steady_s) > SETTLED_WITHIN_S:
            self._since_s, self._steady_s = now_s, found.readout_s
        self._last_s = now_s
        readout_s, std_s = self.readout
        if readout_s is None or std_s is None:
            return out
        if abs(readout_s - self._readout_reported_s) > READOUT_REPORTED_S:
            self._readout_reported_s = readout_s
            text = (
                f"the camera has a rolling shutter, read out in {readout_s * 1e3:.1f} ms; it is allowed for, "
                f"set camera.readout_s = {readout_s:.4f}"
            )
            details = {"readout_s": round(readout_s, 6), "std_s": round(std_s, 6)}
            out.append(event("readout_found", frame, time_unix_us, text, details))
        return out

    def _late(self, frame: int | None, time_unix_us: int) -> list[Event]:
        """A lateness that is surely there, and again when it has surely changed."""
        late_s, std_s = self.found.late_s, self.found.std_s
        at_least = self.found.at_bound
        sure_s = 0.0 if at_least else LATE_SIGMAS * std_s
        if abs(late_s - self._late_reported_s) <= max(LATE_REPORTED_S, sure_s):
            return []
        self._late_reported_s = late_s
        size, side = f"{abs(late_s) * 1e3:.0f} ms", "later" if late_s > 0 else "earlier"
        against = f"than camera.time_offset_s = {self._set_offset_s:g} s says"
        details = {"late_s": round(late_s, 6)}
        if at_least:
            text = f"frames are at least {size} {side} {against}: check it, and what delays the pictures"
            return [event("camera_late", frame, time_unix_us, text, details | {"at_least": True})]
        right_s = round(self._set_offset_s + late_s, 3) + 0.0
        text = f"frames are {size} {side} {against}; it is allowed for, set it to {right_s:.3f}"
        return [event("camera_late", frame, time_unix_us, text, details | {"std_s": round(std_s, 6)})]
