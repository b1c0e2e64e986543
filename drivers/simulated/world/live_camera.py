"""The simulated camera as a live device: pictures at its rate while the simulated vehicle flies."""

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from drivers.cameras.interface import Grab
from drivers.errors import DriverError

POLL_S = 0.002
PATIENCE_S = 5.0

Picture = Callable[[int, float], NDArray[np.uint8] | None]
"""The picture of an exposure: its number and its time; None: nothing comes."""


class SimulatedGrabber:
    """Waits for the physics to pass the next exposure and renders it; a slow machine skips exposures.

    ``now_s`` is the simulated time, ``reached_s`` how far the physics has come, ``stamp_us`` makes the stamp of an
    exposure at a simulated time; ``lag_s``: simulated time that must have passed beyond it (half the exposure, and
    the transport).
    """

    def __init__(
        self,
        picture: Picture,
        now_s: Callable[[], float],
        reached_s: Callable[[], float],
        stamp_us: Callable[[float], int],
        *,
        rate_hz: float,
        lag_s: float = 0.0,
    ) -> None:
        if rate_hz <= 0:
            raise DriverError(f"the simulated camera's rate must be positive, got {rate_hz}")
        self._picture, self._now_s, self._reached_s, self._stamp_us = picture, now_s, reached_s, stamp_us
        self._period_s, self._lag_s = 1.0 / rate_hz, lag_s
        self._number = 0
        self._closed = False

    def open(self) -> None:
        """Begin with the next exposure."""
        self._number = int(self._now_s() / self._period_s) + 1

    def grab(self) -> Grab | None:
        """The next picture; raises DriverError when the camera is unplugged."""
        give_up = time.monotonic() + PATIENCE_S
        due_s = self._number * self._period_s
        while self._reached_s() < due_s + self._lag_s:
            if self._closed:
                return None
            if time.monotonic() > give_up:
                raise DriverError("the simulated vehicle stands still; no picture comes")
            time.sleep(POLL_S)
        number = self._number
        image = self._picture(number, due_s)
        # An exposure that is long past would only be stale: the next one is the first that is still to come.
        self._number = max(number + 1, int((self._reached_s() - self._lag_s) / self._period_s))
        if image is None:
            raise DriverError("the simulated camera is unplugged")
        return Grab(image, self._stamp_us(due_s))

    def close(self) -> None:
        """No more pictures."""
        self._closed = True
