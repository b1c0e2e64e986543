"""Fig. 4: time to contact while a picture of a surface is zoomed into."""

import re
from pathlib import Path

import cv2
import numpy as np

from companion.errors import LandslopeError
from companion.experiments.measure import (
    ERROR_COLUMNS,
    FRAME_S,
    METHODS,
    Errors,
    Job,
    Outcome,
    camera_of,
    estimate_all,
)
from companion.experiments.report import COLOURS, OTHER_COLOUR, Comparison, Section, Table, new_figure, save
from drivers.simulated.world.lens import Lens
from drivers.simulated.world.sequences import plane_sequence

TEXTURES = ("noise", "gravel", "grass", "roof", "tiles")
LAST_TAU = 5
IMAGE_TYPES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".pgm")


def zoom(texture: str, seed: int, tau: int) -> Outcome:
    """One zoom from ``tau`` frames to contact down to five, 256 x 256, 50 degrees."""
    n = tau - LAST_TAU + 1
    # Seen straight on, a texture needs no more than one filtered sample a pixel.
    s = plane_sequence(
        texture, 0.0, motion="z", n=n, tau=tau, distance=0.1 * tau, seed=seed, fine=False, samples=1
    )
    estimates = estimate_all(list(s.images), camera_of(s.lens), [np.eye(3)] * n)
    return Outcome({"name": texture}, {"tau": tau - np.arange(n, dtype=float)}, estimates)


def folder(directory: str, focal_px: float, tau: float) -> Outcome:
    """A folder of zoom images; the picture numbered k has ``tau`` - k frames to contact."""
    files = {}
    for path in Path(directory).iterdir():
        number = re.search(r"(\d+)$", path.stem)
        if path.suffix.lower() in IMAGE_TYPES and number:
            files[int(number[1])] = path
    numbers = sorted(k for k in files if tau - k >= LAST_TAU)
    if len(numbers) < 3:
        raise LandslopeError(
            f"{directory} has {len(numbers)} numbered images with at least {LAST_TAU} frames to contact; need 3"
        )
    if numbers != list(range(numbers[0], numbers[-1] + 1)):
        raise LandslopeError(f"the images of {directory} are not numbered without gaps from {numbers[0]}")
    images = []
    for k in numbers:
        image = cv2.imread(str(files[k]), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise LandslopeError(f"{files[k]} cannot be read as an image")
        images.append(np.asarray(image, dtype=np.uint8))
    height, width = images[0].shape
    matrix = np.array([[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1]])
    estimates = estimate_all(images, camera_of(Lens(width, height, matrix)), [np.eye(3)] * len(images))
    return Outcome({"name": Path(directory).name}, {"tau": tau - np.array(numbers, dtype=float)}, estimates)


def jobs(quick: bool, seed: int) -> list[Job]:
    """Five textures from 200 frames (quick: one from 45)."""
    textures, tau = (TEXTURES[:1], 45) if quick else (TEXTURES, 200)
    return [Job(zoom, {"texture": t, "seed": seed, "tau": tau}) for t in textures]


def relative_error(outcome: Outcome, method: str) -> np.ndarray:
    """(n - 1,) of time to contact, without the first picture, from which nothing can be known."""
    frames = outcome.series(method, "time_to_contact_s") / FRAME_S
    return (frames / outcome.truth["tau"] - 1)[1:]


def section(outcomes: list[Outcome], out: Path, title: str, figure_name: str) -> Section:
    """The report's part on one set of zooms."""
    figure, axes = new_figure(1, 2, 11, 3.8)
    left, right = axes[0]
    for method in METHODS:
        colour = COLOURS.get(method, OTHER_COLOUR)
        for k, o in enumerate(outcomes):
            tau = o.truth["tau"]
            label = method if k == 0 else None
            left.plot(tau, o.series(method, "time_to_contact_s") / FRAME_S, color=colour, lw=0.9, label=label)
            right.semilogy(
                tau[1:], 100 * np.abs(relative_error(o, method)) + 1e-3, color=colour, lw=0.7, label=label
            )
    first = max(float(o.truth["tau"][0]) for o in outcomes)
    left.plot([0, first], [0, first], "k--", lw=1, label="truth")
    left.set(xlabel="true time to contact, frames", ylabel="estimated, frames", ylim=(0, 1.25 * first))
    right.set(xlabel="true time to contact, frames", ylabel="relative error, %", ylim=(1e-2, 200))
    for axis in (left, right):
        axis.invert_xaxis()
    left.legend(frameon=False)
    name = save(figure, out, figure_name)
    rows, pooled = [], {}
    for method in METHODS:
        errors = [relative_error(o, method) for o in outcomes]
        pooled[method] = Errors.of(np.concatenate(errors))
        for o, e in zip(outcomes, errors, strict=True):
            rows.append([method, str(o.label["name"]), *Errors.of(e).cells(2, 100)])
        if len(outcomes) > 1:
            rows.append([f"**{method}**", "**all**", *pooled[method].cells(2, 100)])
    measured = "; ".join(
        f"{m}: median {100 * e.median:.2f} %, p95 {100 * e.p95:.1f} %, worst {100 * e.worst:.1f} %"
        for m, e in pooled.items()
    )
    return Section(
        title,
        "The camera approaches a surface along its axis; time to contact is two over the divergence of the flow.",
        [(name, f"{title}. Estimates over the true time to contact, and their relative errors.")],
        [Table("Relative error of time to contact, %.", ["method", "sequence", *ERROR_COLUMNS], rows)],
        [
            Comparison(
                f"relative error of time to contact, {first:.0f} to {LAST_TAU} frames",
                "time to contact follows from the divergence",
                measured,
            )
        ],
    )
