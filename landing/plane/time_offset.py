"""The camera's times, found along the way where the vehicle turns: how late stamps are, and how long rows take.

A frame stamped late by s was seen s before. Over a baseline the measured rotation old_from_new then is wrong by what
the camera turned in that time at both ends, d = (old_from_new^T w_old - w_new) s in the newest camera's axes, w the
rates of turn. The plane fit finds d from the tracks; a constant rate has no information, a change of the rate has.

A readout that is not known bends the view, much as a rotation and a slope do. Each fit says how its residuals and
its parameters change with it; it differs from a slope in that slopes of one surface must not depend on how the
vehicle turns. Both times are confused with one another by any single baseline, so they are found together.

The filter looks near what is known; where a camera is later by more, the coarse search says where to begin.
"""

import math

import numpy as np
from numpy.typing import NDArray

from landing.motion.views import Views
from landing.plane.coarse_lateness import EARLIEST_S, LATEST_S, CoarseLateness
from landing.plane.plane import Plane, RotationError, RowsError

Array = NDArray[np.float64]

_LEAST_CHANGE = 0.02
"""Change of the rate of turn below which nothing is learnt, rad/s."""
_ORDINARY = 2.0
"""Surprises larger than this, in sigma, count by their size only and not by its square (Huber)."""

_FARTHEST = 10.0
"""Farther away than this, in sigma of what is known at first, it is something else."""
_AT_BOUND = 0.98
"""A lateness of this share of the bound of the search is at least so much."""
_ELSEWHERE_S = 0.05
"""The filter begins anew where the coarse search finds a lateness farther away than this."""

_LEAST_STD_S = 1e-7
"""Doubt that always is left of a time."""
_LONGEST_S = 0.1
"""No readout is longer."""
_ALIKE = 4.0
"""Overlaps of baselines whose errors are alike, by attitudes and by the ground: they have the information of one."""
_SLOPE, _TURN = slice(3, 5), slice(5, 8)
"""Where a fit's parameters are the slopes, and the rotation's error."""


class TimeOffsetFilter:
    """A Kalman filter of two: lateness ``late_s`` beyond the offset that is set, and the readout ``readout_s``.

    ``std_s`` and ``readout_std_s`` are their standard deviations; that of a readout that is known is zero.
    """

    def __init__(
        self,
        std_s: float,
        drift: float,
        attitude_error_std_rad: float,
        readout_s: float = 0.0,
        readout_std_s: float = 0.0,
    ) -> None:
        """``attitude_error_std_rad``: what an attitude is wrong by for other reasons while the vehicle turns."""
        self.late_s, self.readout_s = 0.0, readout_s
        self._covariance = np.diag((std_s**2, readout_std_s**2))
        self._fixed = np.array((std_s == 0, readout_std_s == 0))
        self._attitude_error2 = 2 * attitude_error_std_rad**2
        self._first_std_s, self._drift = std_s, drift
        self._centre_s, self._farthest_s = 0.0, _FARTHEST * std_s
        self._coarse: CoarseLateness | None = None if std_s == 0 else CoarseLateness()
        self._searching = std_s > 0
        self.confirmed = False
        """Whether the coarse search has found the lateness once."""
        self.moved = False
        """Whether the newest step began anew elsewhere."""
        self._last_s: float | None = None

    @property
    def std_s(self) -> float:
        """Standard deviation of the lateness."""
        return math.sqrt(self._covariance[0, 0])

    @std_s.setter
    def std_s(self, std_s: float) -> None:
        self._covariance[0, 1] = self._covariance[1, 0] = 0.0
        self._covariance[0, 0] = std_s**2

    @property
    def readout_std_s(self) -> float:
        """Standard deviation of the readout."""
        return math.sqrt(self._covariance[1, 1])

    @property
    def at_bound(self) -> bool:
        """Whether the lateness lies at a bound of the search: then it is at least so much."""
        if self._first_std_s == 0:
            return False
        near = abs(self.late_s - self._centre_s) >= _AT_BOUND * self._farthest_s
        return near or not _AT_BOUND * EARLIEST_S < self.late_s < _AT_BOUND * LATEST_S

    def loosen(self) -> None:
        """The clocks are set against each other anew: what was found of the lateness is a guess again."""
        self.std_s = self._first_std_s
        self.search()

    def search(self) -> None:
        """Look for the lateness over the whole range again: something contradicts what was found."""
        if self._coarse is not None and not self._searching:
            self._coarse.forget()
            self._searching = True

    def _search(self, views: Views, plane: Plane) -> None:
        """The coarse search, until it is sure."""
        self.moved = False
        if self.at_bound:
            self.search()
        if self._coarse is None or not self._searching:
            return
        found_s = self._coarse.step(views, plane)
        if found_s is None:
            return
        self._searching, self.confirmed = False, True
        if abs(found_s - self.late_s) > _ELSEWHERE_S:
            self.late_s = self._centre_s = found_s
            self.std_s = self._first_std_s
            self.moved = True

    def step(self, views: Views, plane: Plane) -> None:
        """Learn from the newest plane's fit."""
        now_s = views.newest.time_s
        if self._last_s is not None:
            grown = self.std_s**2 + self._drift**2 * (now_s - self._last_s)
            self._covariance[0, 0] = min(grown, self._first_std_s**2)
        self._last_s = now_s
        self._search(views, plane)
        if self.moved:
            return  # the fit is of attitudes of another time
        free = np.diag(self._covariance) > 0
        if plane.rotation_error is None or not free.any():
            return
        change = views.turn_change(plane.gap)
        turning = change is not None and float(change[0] @ change[0]) >= _LEAST_CHANGE**2
        if plane.rows_error is not None and self._covariance[1, 1] > 0:
            per_second, taken_out = change if change is not None and turning else (np.zeros(3), np.zeros(3))
            evidence = self._of_both(
                plane.rotation_error, plane.rows_error, per_second, taken_out, views.rows.readout_s
            )
        elif turning and change is not None:
            evidence = self._of_rotation(plane.rotation_error, *change)
        else:
            return
        self._learn(*evidence, plane.gap)

    def _of_rotation(self, found: RotationError, per_second: Array, taken_out: Array) -> tuple[Array, Array]:
        """Information (2, 2) about both, and what it says of their errors times it (2,): of the lateness alone."""
        # the tracks' own information about d, with the measured rotation's noise: its precision, and that times d
        precision = found.prior_std**-2.0
        evidence = np.diag(precision) - precision[:, None] * found.covariance * precision
        # and with the errors of both attitudes, (I^-1 + Q)^-1 = (1 + I Q)^-1 I with I the information of the tracks
        more = np.eye(3) + self._attitude_error2 * evidence
        both = np.linalg.solve(more, np.column_stack((evidence @ per_second, precision * found.mean)))
        weight = both[:, 0]
        left = per_second * self.late_s - taken_out
        surprise = float(per_second @ both[:, 1]) - float(weight @ left)
        return np.diag((float(per_second @ weight), 0.0)), np.array((surprise, 0.0))

    def _of_both(
        self, found: RotationError, rows: RowsError, per_second: Array, taken_out: Array, applied_s: float
    ) -> tuple[Array, Array]:
        """The same of both times: the fit's own equations with them as unknowns, its parameters eliminated.

        The rotation's error has the lateness as its mean, the residuals change with the readout, and so do the slopes
        fused before, which those of the fit should be.
        """
        precision = found.prior_std**-2.0
        looser = 1.0 / (found.prior_std**2 + self._attitude_error2)
        more_s = self.readout_s - applied_s
        left = found.mean - (per_second * self.late_s - taken_out)
        apart = rows.difference - rows.before_gradient * more_s
        inside = np.linalg.inv(rows.covariance)
        inside[_TURN, _TURN] += np.diag(looser - precision)
        inside[_SLOPE, _SLOPE] += rows.before
        cross = np.zeros((len(inside), 2))
        cross[_TURN, 0] = -looser * per_second
        cross[:, 1] = -rows.gradient
        cross[_SLOPE, 1] -= rows.before @ rows.before_gradient
        right = rows.gradient * more_s
        right[_TURN] += precision * found.mean - looser * left
        right[_SLOPE] -= rows.before @ apart
        pull = rows.before_gradient @ rows.before
        own = np.diag((per_second @ (looser * per_second), rows.information + pull @ rows.before_gradient))
        towards = np.array(
            (per_second @ (looser * left), rows.score - rows.information * more_s + pull @ apart)
        )
        eliminated = np.linalg.solve(inside, np.column_stack((cross, right)))
        return own - cross.T @ eliminated[:, :2], towards - cross.T @ eliminated[:, 2]

    def _learn(self, information: Array, surprise: Array, gap: int) -> None:
        """Take in what a baseline of ``gap`` frames says; nothing where it says nothing, or no number."""
        if not (np.isfinite(information).all() and np.isfinite(surprise).all()):
            return
        # an information below zero is rounding
        eigenvalues, axes = np.linalg.eigh((information + information.T) / 2)
        if not eigenvalues[-1] > 0:
            return
        information = (axes * np.maximum(eigenvalues, 0.0)) @ axes.T
        # the innovation over the standard deviations of prediction and measurement
        sigmas = math.sqrt(max(float(surprise @ self._of(information, surprise)), 0.0))
        # baselines that overlap say the same again
        share = min(1.0, _ORDINARY / max(sigmas, 1e-9)) / gap
        if information[1, 1] > 0:
            share /= _ALIKE
        # (P^-1 + I)^-1 by the square root of P: it stays positive
        root = np.linalg.cholesky(self._covariance + np.diag(np.full(2, _LEAST_STD_S**2)))
        inside = np.linalg.inv(np.eye(2) + share * (root.T @ information @ root))
        updated = root @ ((inside + inside.T) / 2) @ root.T
        updated[self._fixed] = 0.0
        updated[:, self._fixed] = 0.0
        self._covariance = updated
        late_s, readout_s = self._covariance @ (share * surprise)
        lowest_s, highest_s = self._centre_s - self._farthest_s, self._centre_s + self._farthest_s
        self.late_s = min(max(self.late_s + float(late_s), lowest_s), highest_s)
        if self.at_bound:
            self.std_s = self._first_std_s
        self.readout_s = min(max(self.readout_s + float(readout_s), -_LONGEST_S), _LONGEST_S)

    def _of(self, information: Array, surprise: Array) -> Array:
        """The surprise (2,) over its covariance, that of a measurement with this information."""
        spread = information + information @ self._covariance @ information
        return np.asarray(np.linalg.lstsq(spread, surprise, rcond=1e-9)[0], np.float64)
