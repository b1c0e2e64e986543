"""What errors of the lens do to places in the picture, and to slopes."""

import numpy as np
import pytest

from landing.errors import LandingError
from landing.options import EstimatorOptions
from landing.plane.planefit import FitPrior, fit_plane
from landing.vision.camera import CameraModel
from landing.vision.homography import towards
from landing.vision.lens_doubt import LensDoubt, usual_covariance

MATRIX = np.array(((318.0, 0, 172.0), (0, 318.0, 115.0), (0, 0, 1)))
DISTORTION = np.array((-0.4, 0.16, 0.0, 0.0, 0.0))
OPTIONS = EstimatorOptions()


def camera(covariance: np.ndarray | None = None, distortion: np.ndarray = DISTORTION) -> CameraModel:
    return CameraModel(320, 240, MATRIX, distortion, intrinsics_covariance=covariance)


def test_a_lens_known_exactly_has_no_doubt() -> None:
    assert LensDoubt(camera(np.zeros((9, 9)))).modes == 0


def test_a_covariance_of_another_size_or_not_finite_is_refused() -> None:
    for wrong in (np.eye(8), np.full((9, 9), np.nan)):
        with pytest.raises(LandingError, match="covariance"):
            camera(wrong)


def test_one_error_moves_places_as_the_lens_with_it_does() -> None:
    covariance = np.zeros((9, 9))
    covariance[2, 2] = 1.5**2
    doubt = LensDoubt(camera(covariance))
    pixels = np.array(((30.0, 40.0), (160.0, 120.0), (300.0, 210.0)))
    change = np.zeros(9)
    change[2] = 1.5
    true = camera().changed(change).undistort(pixels) - camera().undistort(pixels)
    assert doubt.modes == 1
    moved = doubt.moves(pixels)[0]
    # one value a cell: within what a field changes over half of it
    assert np.abs(np.abs(moved) - np.abs(true)).max() < 0.06 * np.abs(true).max()


@pytest.mark.parametrize("usual", [True, False])
def test_a_wrong_lens_bends_slopes_within_what_the_fit_says(usual: bool) -> None:
    """Many lenses, each wrong by the doubt: slopes of the noiseless fit spread by the fit's own figure."""
    rng = np.random.default_rng(5)
    covariance = None
    if not usual:
        covariance = np.diag((1.0, 1.0, 4.0, 4.0, 1e-4, 0, 1e-7, 1e-7, 0))
    stated = camera(covariance)
    doubt = LensDoubt(stated)
    pixels_new = np.column_stack((rng.uniform(40, 280, 120), rng.uniform(40, 200, 120)))
    normal, t = np.array((-0.1, 0.2, 1.0)), np.array((0.09, -0.05, 0.03))
    new = stated.undistort(pixels_new)
    there = np.column_stack((new, np.ones(120))) @ towards(t.tolist(), normal.tolist()).T
    old = there[:, :2] / there[:, 2:]
    pixels_old = stated.project(old)
    whitener = np.stack((np.full(120, 318 / 0.05), np.zeros(120), np.full(120, 318 / 0.05)))
    prior = FitPrior(np.full(3, 5e-4))

    def fitted(seen: CameraModel) -> tuple[float, float]:
        fit = fit_plane(
            seen.undistort(pixels_new), seen.undistort(pixels_old), np.eye(3), whitener, prior, (t, 0.1, -0.2)
        )
        assert fit is not None
        return fit.a, fit.b

    moves = doubt.moves(pixels_new), doubt.moves(pixels_old)
    fit = fit_plane(new, old, np.eye(3), whitener, prior, (t, 0.1, -0.2), lens_moves=moves)
    assert fit is not None
    assert fit.lens.shape == (8, doubt.modes)
    said = np.sqrt((fit.lens[3:5] ** 2).sum(axis=1))
    spread = np.asarray(usual_covariance(stated) if covariance is None else covariance)
    errors = rng.multivariate_normal(np.zeros(9), spread, 200)
    found = np.array([fitted(stated.changed(error)) for error in errors]) - (0.1, -0.2)
    seen = np.sqrt((found**2).mean(axis=0))
    assert seen == pytest.approx(said, rel=0.25)
    assert (said > np.radians(0.03)).all()
