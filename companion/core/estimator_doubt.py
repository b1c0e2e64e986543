"""How far the autopilot's velocity and attitude are believed, by what its estimator says of itself.

Without such a report the errors that the settings name are taken. A report can only add to them: an estimator's own
variance speaks of noise, not of a mount or a scale. Without a velocity the attitude has only gravity to level by, and
takes every acceleration that lasts for tilt.
"""

import math
from dataclasses import dataclass

from drivers.samples import EstimatorReport

MAX_AGE_S = 10.0
"""Reports come at 1 Hz or more; when they stop, what they vouched for is not known any more."""
ASSUMED_VELOCITY_STD = 0.2
"""``Observation.velocity_std`` where nothing is reported, m/s."""
UNAIDED_TILT_STD = math.radians(1.1)
"""Roll and pitch without a velocity, one sigma: seen on ArduCopter and PX4 in simulation without GPS."""
LOST_TILT_STD = math.radians(10.0)
"""Where the estimator itself does not know them."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """``velocity_known``: False, none is to be used. ``velocity_factor``: its error over the assumed one, at least 1.

    ``tilt_std`` rad, beyond what is assumed.
    """

    velocity_known: bool = True
    velocity_factor: float = 1.0
    tilt_std: float = 0.0

    @property
    def unaided(self) -> bool:
        """Whether anything is wrong enough to be a condition of its own."""
        return not self.velocity_known or self.tilt_std >= UNAIDED_TILT_STD


NO_DOUBT = Doubt()
"""No report: the assumed errors hold."""


class EstimatorDoubt:
    """The newest report of each message; ``forget`` at a reboot."""

    def __init__(self) -> None:
        self._reports: dict[str, tuple[int, EstimatorReport]] = {}

    def forget(self) -> None:
        """The estimator started anew."""
        self._reports.clear()

    def feed(self, report: EstimatorReport, now_us: int) -> None:
        """Take one report."""
        self._reports[report.source] = now_us, report

    def at(self, now_us: int) -> Doubt:
        """What is believed now."""
        known, factor, tilt = True, 1.0, 0.0
        for at_us, report in self._reports.values():
            fresh = now_us - at_us <= MAX_AGE_S * 1e6
            if report.velocity_known is not None:
                known = known and fresh and report.velocity_known
            if report.attitude_known is False:
                tilt = max(tilt, LOST_TILT_STD)
            if report.velocity_std is not None:
                factor = max(factor, report.velocity_std / ASSUMED_VELOCITY_STD)
            if report.tilt_std is not None:
                tilt = max(tilt, report.tilt_std)
        return Doubt(known, factor, tilt if known else max(tilt, UNAIDED_TILT_STD))
