"""The pipeline on sequences of pictures whose surface and motion are known exactly; prints its errors as a program.

``python tests/tools/image_sequences.py`` runs rendered planes (``--fine``: every pixel averaged),
``python tests/tools/image_sequences.py FOLDER`` a zoom on a flat
surface: image_1.jpg to image_99.jpg, between image k and k + 1 growing about the centre by tau / (tau - 1), tau =
100 - k.
"""

import dataclasses
import itertools
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulated.world.sequences import PlaneSequence, plane_sequence
from landing.estimate import SurfaceEstimate
from landing.observation import Observation
from landing.options import Options
from landing.pipeline import SurfacePipeline
from landing.vision.camera import DOWN, CameraModel

Array = NDArray[np.float64]

RATE_HZ = 30.0
WARM_UP = 8
SLOPES_DEG = (0.0, 15.0, 30.0, 45.0, 60.0)
TEXTURES = ("noise", "gravel", "roof")
ZOOM_FOCAL_PX = 274.5
ZOOM_IMAGES = 99


def estimates(
    images: Iterable[NDArray[np.uint8]],
    camera: CameraModel,
    options: Options | None = None,
    attitudes: Sequence[Array | None] | None = None,
    rotation_std_rad: float = 1e-5,
) -> list[SurfaceEstimate]:
    """One estimate a picture, taken at ``RATE_HZ``; ``attitudes`` are ned_from_body, level without."""
    pipeline = SurfacePipeline(camera, options or Options())
    out = []
    for k, image in enumerate(images):
        attitude = np.eye(3) if attitudes is None else attitudes[k]
        out.append(pipeline.step(Observation(k, k / RATE_HZ, image, attitude, rotation_std_rad)))
    return out


def camera_of(made: PlaneSequence) -> CameraModel:
    """The camera that took the pictures."""
    lens = made.lens
    return CameraModel(lens.width, lens.height, lens.matrix, lens.distortion, DOWN)


def slope_errors_deg(made: PlaneSequence, found: list[SurfaceEstimate]) -> Array:
    """Errors (n, 2) of both slope angles, NaN where there is no estimate."""
    return np.array([(e.slope_x_deg, e.slope_y_deg) for e in found]) - np.array(made.slope_deg)


def zoom(folder: Path, options: Options | None = None) -> tuple[Array, list[SurfaceEstimate]]:
    """Time to contact in frames (99,) at each picture of the zoom, and the estimates."""
    images = [
        cv2.imread(str(folder / f"image_{k}.jpg"), cv2.IMREAD_GRAYSCALE) for k in range(1, ZOOM_IMAGES + 1)
    ]
    camera = CameraModel.from_focal(256, 256, ZOOM_FOCAL_PX)
    return 100.0 - np.arange(1, ZOOM_IMAGES + 1), estimates(images, camera, options)


def time_to_contact_errors(tau: Array, found: list[SurfaceEstimate]) -> Array:
    """Relative errors (n,) of the time to contact; ``tau`` in frames."""
    estimated = np.array([e.time_to_contact_s for e in found]) * RATE_HZ
    return np.abs(estimated / tau - 1)


def figures(errors: Array) -> str:
    """Median, 95th percentile, worst and how many are missing."""
    known = errors[np.isfinite(errors)]
    if not len(known):
        return "nothing"
    median, p95 = np.percentile(known, (50, 95))
    return f"{median:.3f} / {p95:.3f} ({known.max():.3f}), {np.isnan(errors).sum()} of {errors.size} missing"


def rendered(motion: str, options: dict[str, Options], fine: bool) -> None:
    """Print the errors in one motion, of every slope and pooled over textures and axes, for each set of options."""
    slope: dict[str, list[Array]] = {name: [] for name in options}
    sigma: dict[str, list[Array]] = {name: [] for name in options}
    contact: dict[str, list[Array]] = {name: [] for name in options}
    frames = 60 if motion == "z" else 24
    for slope_deg in SLOPES_DEG:
        for texture, axis in itertools.product(TEXTURES, "xy"):
            made = plane_sequence(texture, slope_deg, axis, motion, frames, tau=65.0, fine=fine)
            for name, chosen in options.items():
                found = estimates(made.images, camera_of(made), chosen)
                error = np.abs(slope_errors_deg(made, found))[WARM_UP:]
                std = np.array([(e.slope_x_std_deg, e.slope_y_std_deg) for e in found])[WARM_UP:]
                slope[name].append(error)
                sigma[name].append(error / std)
                contact[name].append(time_to_contact_errors(made.time_to_contact, found)[WARM_UP:])
        for name in options:
            last = np.concatenate(slope[name][-2 * len(TEXTURES) :])
            print(f"  {motion} {slope_deg:2.0f} degrees, {name}: {figures(last)}", flush=True)
    for name in options:
        print(f"{motion}, {name}: {figures(np.concatenate(slope[name]))}")
        print(f"   over sigma {figures(np.concatenate(sigma[name]))}")
        if motion == "z":
            print(f"   time to contact {figures(np.concatenate(contact[name]))}", flush=True)


def main() -> None:
    """Print the figures."""
    options = Options()
    if len(sys.argv) > 1 and Path(sys.argv[1]).is_dir():
        tau, found = zoom(Path(sys.argv[1]), options)
        error = time_to_contact_errors(tau, found)
        known = (tau >= 5) & (np.arange(len(tau)) > 0)
        print("time to contact, tau 99 to 5:", figures(error[known]))
        for first in range(0, 99, 10):
            print(f"  tau {tau[first]:.0f}:", figures(error[first : first + 10]))
        return
    exact = dataclasses.replace(options.estimator, rotation_std_rad=1e-5, yaw_std_rad=1e-5)
    sets = {
        "rotation believed as on a vehicle": options,
        "rotation believed exactly": dataclasses.replace(options, estimator=exact),
    }
    for motion in "xyz":
        rendered(motion, sets, "--fine" in sys.argv)


if __name__ == "__main__":
    main()
