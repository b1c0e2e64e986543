"""Runs the pipeline over images, once for every estimator method, and computes the statistics of errors.

In: grey images, the camera, and the attitudes where they are known. Out: ``SurfaceEstimate`` per image and method.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.world.lens import Lens
from landing.estimate import SurfaceEstimate
from landing.observation import Observation
from landing.options import EstimatorOptions, Options
from landing.pipeline import ESTIMATORS, SurfacePipeline
from landing.vision.camera import CameraModel

Array = NDArray[np.float64]

METHODS = tuple(ESTIMATORS)
FRAME_S = 1 / 30
"""Time between pictures; the paper counts in frames."""
EXACT_ROTATION_RAD = 1e-5
"""Standard deviation of a rotation that is known."""


@dataclass(frozen=True)
class Outcome:
    """What a job measured: ``truth`` by name, arrays of one value a frame, and the estimates of every method."""

    label: dict[str, Any]
    truth: dict[str, Array]
    estimates: dict[str, list[SurfaceEstimate]]

    def series(self, method: str, field: str) -> Array:
        """(n,) one field of the estimates; NaN where it is unknown."""
        return np.array([getattr(e, field) for e in self.estimates[method]], dtype=np.float64)

    def ok(self, method: str) -> NDArray[np.bool_]:
        """(n,) whether the status is "ok"."""
        return np.array([e.status == "ok" for e in self.estimates[method]])


@dataclass(frozen=True)
class Job:
    """A function of a module and its arguments, to be run in any process."""

    function: Callable[..., Outcome]
    arguments: Mapping[str, Any]

    def __call__(self) -> Outcome:
        return self.function(**self.arguments)


@dataclass(frozen=True)
class Errors:
    """Statistics of absolute errors; ``failures`` frames of ``frames`` had no estimate."""

    median: float
    p95: float
    worst: float
    frames: int
    failures: int

    @classmethod
    def of(cls, errors: Iterable[float]) -> "Errors":
        """From signed errors, NaN for a failure."""
        values = np.abs(np.fromiter(errors, dtype=np.float64))
        known = values[np.isfinite(values)]
        if not len(known):
            return cls(math.nan, math.nan, math.nan, len(values), len(values))
        median, p95 = np.percentile(known, [50, 95])
        return cls(float(median), float(p95), float(known.max()), len(values), len(values) - len(known))

    def cells(self, digits: int = 2, factor: float = 1.0) -> list[str]:
        """Median, 95th percentile, worst and failures as a table's cells."""
        statistics = (self.median, self.p95, self.worst)
        numbers = [f"{factor * v:.{digits}f}" if math.isfinite(v) else "none" for v in statistics]
        return [*numbers, f"{self.failures} of {self.frames}"]


ERROR_COLUMNS = ["median", "p95", "worst", "failures"]


def camera_of(lens: Lens) -> CameraModel:
    """The estimator's camera for a simulated lens: calibrated exactly."""
    return CameraModel(
        lens.width,
        lens.height,
        lens.matrix,
        lens.distortion,
        lens.body_from_camera,
        equidistant=lens.equidistant,
    )


def estimate_all(
    images: Sequence[NDArray[np.uint8]],
    camera: CameraModel,
    attitudes: Sequence[Array] | None,
    *,
    rotation_std_rad: float = EXACT_ROTATION_RAD,
    use_attitude: bool = True,
    variants: Mapping[str, EstimatorOptions] | None = None,
) -> dict[str, list[SurfaceEstimate]]:
    """Estimates of every method, one a picture; ``attitudes`` (n of (3, 3) ned_from_body) or None for unknown.

    ``variants`` are further estimators by name.
    """
    result = {}
    estimators = {m: EstimatorOptions(method=m) for m in METHODS} | dict(variants or {})  # type: ignore[arg-type]
    for method, estimator in estimators.items():
        pipeline = SurfacePipeline(camera, Options(estimator=replace(estimator, use_attitude=use_attitude)))
        estimates = []
        for k, image in enumerate(images):
            attitude = None if attitudes is None else attitudes[k]
            estimate = pipeline.step(Observation(k, k * FRAME_S, image, attitude, rotation_std_rad))
            estimates.append(replace(estimate, tracks=None))
        result[method] = estimates
    return result


def auc(low: Array, high: Array) -> float:
    """Probability that a value of ``low`` lies under one of ``high`` (ties count half); NaN without both."""
    low, high = low[np.isfinite(low)], high[np.isfinite(high)]
    if not len(low) or not len(high):
        return math.nan
    return float(np.mean((low[:, None] < high[None]) + 0.5 * (low[:, None] == high[None])))
