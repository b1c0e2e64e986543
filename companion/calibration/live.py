"""Calibrating from a live camera: what has been seen of the board, what is missing, and when it is enough."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from companion.calibration.board import BoardFinder
from companion.calibration.calibration import (
    COVERAGE_COLUMNS,
    COVERAGE_ROWS,
    Calibration,
    CalibrationOptions,
    Collected,
    ViewCollector,
    calibrate,
    cells_seen,
)
from companion.calibration.solve import Lens
from companion.errors import LandslopeError
from drivers.cameras import Camera
from drivers.samples import Frame

SOLVE_EVERY = 3
"""New views between two attempts at a solution, which take up to seconds on a small board."""
POLL_S = 0.5
SILENCE_S = 30.0
"""A camera without a frame for so long ends the calibration."""

Show = Callable[[str], None]


class LiveCalibration:
    """Takes pictures until the views are good enough; ``result`` is the calibration then."""

    def __init__(self, finder: BoardFinder, options: CalibrationOptions, lens: Lens) -> None:
        self._finder, self._options, self._lens = finder, options, lens
        self._collector = ViewCollector(finder, options)
        self._tried = 0
        self._refusal = ""
        self.result: Calibration | None = None
        self.pictures = 0

    def step(self, image: NDArray[np.uint8]) -> bool:
        """Take one picture; whether it gave a new view."""
        self.pictures += 1
        new = self._collector.add(f"frame {self.pictures}", image)
        views = len(self.collected.views)
        if new and views >= self._options.min_views and views - self._tried >= SOLVE_EVERY:
            self._tried = views
            self.finish()
        return new

    def finish(self) -> str:
        """Try to calibrate with what there is; the refusal, empty where it worked."""
        found = self.collected
        try:
            self.result = calibrate(
                found.views, found.pictures, found.size, self._finder, self._options, self._lens
            )
            self._refusal = ""
        except LandslopeError as error:
            self._refusal = str(error)
        return self._refusal

    @property
    def collected(self) -> Collected:
        """The views so far."""
        return self._collector.collected

    def missing(self) -> str:
        """What is still missing, in words."""
        found, least = self.collected, self._options.min_views
        if not found.views:
            return "no board seen yet: hold it so that it is in the picture, sharp and lit"
        if len(found.views) < least:
            return f"{least - len(found.views)} more views, from other sides and distances; {empty_places(found)}"
        return self._refusal or f"a few more views; {empty_places(found)}"

    def drawn(self) -> str:
        """Coverage as lines of # and . and a line of words."""
        found = self.collected
        lines = coverage_lines(found)
        return "\n".join([*lines, f"{len(found.views)} views. Missing: {self.missing()}"])


def coverage_lines(found: Collected) -> list[str]:
    """One line a row of the grid: # where corners were seen, . where not yet."""
    if not found.views:
        return ["." * COVERAGE_COLUMNS] * COVERAGE_ROWS
    seen = cells_seen(found.views, found.size) > 0
    return ["".join("#" if cell else "." for cell in row) for row in seen]


def empty_places(found: Collected) -> str:
    """The corner or side of the picture where the board was seen least."""
    seen = cells_seen(found.views, found.size) > 0
    rows, columns = (
        np.array_split(np.arange(COVERAGE_ROWS), 3),
        np.array_split(np.arange(COVERAGE_COLUMNS), 3),
    )
    places = {
        f"{upper}{left}".strip() or "middle": float(seen[np.ix_(r, c)].mean())
        for upper, r in zip(("upper ", "", "lower "), rows, strict=True)
        for left, c in zip(("left", "", "right"), columns, strict=True)
    }
    least = min(places, key=lambda name: places[name])
    if places[least] == 1:
        return "tilt it by 20 to 45 degrees"
    return f"bring it to the {least} of the picture"


def run_live(camera: Camera, live: LiveCalibration, show: Show) -> Calibration:
    """Read a camera until the views are enough, or it ends; LandslopeError where they are not, or no frame comes."""
    silent_s = 0.0
    show(live.drawn())
    while live.result is None:
        samples = camera.read(POLL_S)
        frames = [sample for sample in samples if isinstance(sample, Frame)]
        status = camera.status()
        if frames:
            silent_s = 0.0
            if live.step(frames[-1].image):
                show(live.drawn())
        elif status.state == "ended":
            refusal = live.finish()
            if refusal:
                raise LandslopeError(refusal)
        else:
            silent_s += POLL_S
            if silent_s >= SILENCE_S:
                raise LandslopeError(
                    f"no frame for {SILENCE_S:.0f} s: {status.problem or 'the camera gives none'}; check camera.source"
                )
    return live.result
