"""How long a camera's rows take, from a recorded flight: what the estimator finds of it in flight, at the flight's end.

The plane fits say how their residuals, their rotation and their slopes change with the readout
(landing/plane/time_offset.py); a Kalman filter finds readout and lateness together, since any single baseline confuses
them.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from companion.core.core import Core
from companion.errors import LandslopeError
from companion.messages.messages import Health
from companion.settings.settings import Settings
from drivers.samples import Sample
from landing.options import Limits
from landing.vision.camera import CameraModel


@dataclass(frozen=True, slots=True)
class ReadoutOptions:
    """When a measurement of the readout is refused."""

    min_settled: Annotated[int, Limits(2, 100, "", "fewest seconds in which the value has stood")] = 3
    max_std_s: Annotated[float, Limits(0.0002, 0.02, "s", "largest uncertainty of the result")] = 0.002


@dataclass(frozen=True, slots=True)
class Readout:
    """Time from the first row to the last, s, negative when the last is first; one sigma; seconds it has stood."""

    readout_s: float
    std_s: float
    settled_s: int


def measure_readout(
    samples: Iterable[Sample],
    camera: CameraModel,
    settings: Settings,
    options: ReadoutOptions | None = None,
) -> Readout:
    """The readout of a flight's camera, whose model must leave it open (``readout_s`` None).

    The uncertainty is the filter's own and the spread of what it has found since it settled. Raises LandslopeError when
    the flight has too little information.
    """
    options = options or ReadoutOptions()
    core = Core(settings, camera, calibrated=True, telemetry=True)
    found: list[tuple[float, float]] = []

    def take(outputs: Iterable[object]) -> None:
        for output in outputs:
            if not isinstance(output, Health):
                continue
            if output.camera_readout_s is None or output.camera_readout_std_s is None:
                found.clear()  # it has begun to move again
            else:
                found.append((output.camera_readout_s, output.camera_readout_std_s))

    for sample in samples:
        take(core.feed(sample))
    take(core.finish())
    if len(found) < options.min_settled:
        raise LandslopeError(
            "the rows' readout was not found: turn more, unevenly and about both level axes, over ground with texture"
        )
    values = np.array(found)
    std_s = float(np.hypot(values[-1, 1], values[:, 0].std()))
    if std_s > options.max_std_s:
        raise LandslopeError(
            f"the rows' readout would be {values[-1, 0] * 1e3:.1f} ms, but uncertain by {std_s * 1e3:.1f} ms, at most "
            f"{options.max_std_s * 1e3:g} ms are allowed: turn more, or longer"
        )
    return Readout(float(values[-1, 0]), std_s, len(found))
