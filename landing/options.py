"""Every threshold of the mathematics: a bounded field with a unit and a default."""

from dataclasses import dataclass, field
from typing import Annotated, Literal


@dataclass(frozen=True, slots=True)
class Limits:
    """The closed range of a number, its unit and its meaning; stands in ``Annotated`` behind the type."""

    low: float
    high: float
    unit: str = ""
    meaning: str = ""


@dataclass(frozen=True, slots=True)
class TrackingOptions:
    """Corners and their tracks."""

    max_features: Annotated[int, Limits(20, 1000, "", "corners tracked at once")] = 150
    window_px: Annotated[int, Limits(5, 41, "px", "side of the Lucas-Kanade window")] = 15
    forward_backward_max_px: Annotated[
        float, Limits(0.05, 5, "px", "a track that does not come back to its start within this is refused")
    ] = 0.5


@dataclass(frozen=True, slots=True)
class EstimatorOptions:
    """How the flow field becomes a plane."""

    method: Literal["map", "quadratic"] = "map"
    seed: Annotated[int, Limits(0, 2**31 - 1, "", "seed of the random hypotheses")] = 1
    use_attitude: bool = True


@dataclass(frozen=True, slots=True)
class DecisionOptions:
    """When a surface counts as fit for landing."""

    max_inclination_deg: Annotated[float, Limits(1, 45, "deg", "steepest surface that is landed on")] = 10.0
    max_roughness: Annotated[float, Limits(0.001, 0.2, "", "largest RMS relief over distance landed on")] = 0.009
    dwell_s: Annotated[float, Limits(0, 10, "s", "how long a surface must be flat before it is fit")] = 0.5


@dataclass(frozen=True, slots=True)
class Options:
    """All of the above, as one pipeline takes them."""

    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)
    decision: DecisionOptions = field(default_factory=DecisionOptions)
