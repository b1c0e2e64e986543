"""How far two recordings of the same rotation lie apart in time: cost at every shift, minimum, uncertainty."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def robust_costs(errors: Callable[[float], Array], information: Array, shifts: Array) -> Array:
    """The cost (m, n) of n errors at each of m shifts.

    ``errors`` gives (n, 3) rad at a shift, ``information`` is (n, 3, 3) in 1/rad^2.
    """
    roots = np.linalg.cholesky(information)
    squares = np.empty((len(shifts), len(information)))
    for row, shift in enumerate(shifts):
        squares[row] = (np.einsum("nij,ni->nj", roots, errors(float(shift))) ** 2).sum(axis=1)
    scale = np.median(squares[squares.sum(axis=1).argmin()]) + 1e-12
    return np.log1p(squares / scale)  # Cauchy: a bad pair has little weight


def minimum(shifts: Array, cost: Array) -> tuple[float, bool]:
    """The shift of least cost, between the samples by a parabola, and whether it lies at the edge of the search."""
    k = int(cost.argmin())
    if k in (0, len(shifts) - 1):
        return float(shifts[k]), True
    left, middle, right = cost[k - 1 : k + 2]
    bend = left - 2 * middle + right
    part = 0.5 * (left - right) / bend if bend > 0 else 0.0
    return float(shifts[k] + part * (shifts[1] - shifts[0])), False


def jackknife(shifts: Array, terms: Array, offset: float, blocks: int) -> float:
    """One sigma of the offset: how it moves when one stretch of the flight after another is left out."""
    parts = np.array_split(np.arange(terms.shape[1]), blocks)
    whole = terms.sum(axis=1)
    without = np.array([minimum(shifts, whole - terms[:, part].sum(axis=1))[0] for part in parts])
    return math.sqrt((blocks - 1) / blocks * float(((without - offset) ** 2).sum()))
