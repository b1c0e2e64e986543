"""What may disturb a flight without stopping it: named edits of samples, and of the tracks themselves.

``python tests/support/nuisances.py`` prints the errors of every cut under every nuisance.
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import sample_edits
from numpy.typing import NDArray
from places import REPOSITORY
from score import EVEN, SLOPE_MARGIN_DEG, UNEVEN, WHOLE_PLANE, truth_of

from companion.core.core import Core, Processed
from companion.replay.source import PlainCamera, ReplaySource, open_source
from drivers.samples import Attitude, Frame, Imu, Sample
from landing.estimate import SurfaceEstimate
from landing.vision.tracking import FeatureTracker

FLIGHTS = REPOSITORY / "sitl_logs"
CUTS = {
    "steep": ("ramp_a", 17.2, 20.0),
    "agile": ("agile_a", 8.5, 12.0),
    "stairs": ("stairs_a", 14.0, 18.0),
    "descent": ("descent_a", 10.5, 13.3),
}
"""Flight, start and end in seconds: 20 degrees of slope, level ground in a fast turn, stairs to floor, 15 degrees
straight down."""

LIMIT_DEG = 10.0
FRAME_COST_US = 100_000
"""Four times what a frame costs a small board."""
Image = NDArray[np.uint8]
Edit = Callable[[list[Sample]], list[Sample]]


@cache
def cut(name: str) -> tuple[ReplaySource, tuple[Sample, ...]]:
    """The samples of a cut, in order of arrival."""
    flight, start_s, end_s = CUTS[name]
    source = open_source(FLIGHTS / flight, None, (), PlainCamera())
    begin_us, kept = None, []
    for sample in source.samples():
        begin_us = sample.arrival_us if begin_us is None else begin_us
        since_s = (sample.arrival_us - begin_us) * 1e-6
        if since_s >= end_s:
            break
        if since_s >= start_s:
            kept.append(sample)
    return source, tuple(kept)


def pictures(change: Callable[[int, Image], Image]) -> Edit:
    """An edit of every picture, by its number."""

    def edit(samples: list[Sample]) -> list[Sample]:
        return [replace(s, image=change(s.number, s.image)) if isinstance(s, Frame) else s for s in samples]

    return edit


def gyro_bias(rate_deg: float) -> Edit:
    """About all three axes."""
    bias = np.radians(rate_deg)

    def edit(samples: list[Sample]) -> list[Sample]:
        out: list[Sample] = []
        for s in samples:
            if isinstance(s, Imu):
                s = replace(s, rate=tuple(rate + bias for rate in s.rate))
            elif isinstance(s, Attitude):
                s = replace(
                    s,
                    rollspeed=s.rollspeed + bias,
                    pitchspeed=s.pitchspeed + bias,
                    yawspeed=s.yawspeed + bias,
                )
            out.append(s)
        return out

    return edit


def late_stamps(by_us: int) -> Edit:
    """Frames are stamped, and arrive, later than they were taken."""

    def edit(samples: list[Sample]) -> list[Sample]:
        moved = [
            replace(s, stamp_us=s.stamp_us + by_us, arrival_us=s.arrival_us + by_us)
            if isinstance(s, Frame)
            else s
            for s in samples
        ]
        return sorted(moved, key=lambda s: s.arrival_us)

    return edit


def slow_attitude(samples: list[Sample]) -> list[Sample]:
    """Attitude at 10 Hz and gyro at 50 Hz of the 100 recorded."""
    return sample_edits.thin(sample_edits.thin(samples, Attitude, 10), Imu, 2)


def quarter_of_a_core(samples: list[Sample]) -> list[Sample]:
    """A frame takes FRAME_COST_US; of those that come meanwhile the newest is next, as with the camera's reader."""
    out: list[Sample] = []
    free_us, newest = 0, None
    for s in samples:
        if newest is not None and s.arrival_us >= free_us:
            out.append(newest)
            free_us, newest = free_us + FRAME_COST_US, None
        if not isinstance(s, Frame):
            out.append(s)
        elif s.arrival_us >= free_us:
            out.append(s)
            free_us = s.arrival_us + FRAME_COST_US
        else:
            newest = s
    return out


def half_blank(number: int, image: Image) -> Image:
    """The left half has no texture but the sensor's noise."""
    out, middle = image.copy(), image.shape[1] // 2
    noise = np.random.default_rng(number).normal(0, 2, (image.shape[0], middle))
    out[:, :middle] = np.clip(np.rint(128 + noise), 0, 255)
    return out


def brightness_steps(number: int, image: Image) -> Image:
    """Thirty per cent darker and back, every third of a second."""
    return image if number // 10 % 2 else (image * 0.7).astype(np.uint8)


def shadow(number: int, image: Image) -> Image:
    """A band of 15 % of the image, half as bright, wanders across it."""
    out, width = image.copy(), image.shape[1]
    wide = round(0.15 * width)
    left = number * 4 % (width + wide) - wide
    out[:, max(left, 0) : max(left + wide, 0)] //= 2
    return out


def propeller(number: int, image: Image) -> Image:
    """A dark blade turns within the upper right corner: a disk over 15 % of the image, blurred by its own speed."""
    height, width = image.shape
    v, u = np.mgrid[:height, :width]
    du, dv = u - width * 0.85, v - height * 0.1
    radius = np.sqrt(0.15 * width * height * 2 / np.pi)
    angle = (np.arctan2(dv, du) - 2.3 * number) % np.pi
    blade = (du**2 + dv**2 < radius**2) & (np.minimum(angle, np.pi - angle) < 0.35)
    out = image.copy()
    out[blade] = 30 + out[blade] // 8
    return out


NUISANCES: dict[str, Edit] = {
    "nothing": lambda samples: samples,
    "gyro bias of 1 deg/s": gyro_bias(1.0),
    "frames 20 ms late": late_stamps(20_000),
    "frames 20 ms early": late_stamps(-20_000),
    "attitude at 10 Hz": slow_attitude,
    "a quarter of a core": quarter_of_a_core,
    "half without texture": pictures(half_blank),
    "brightness steps of 30 %": pictures(brightness_steps),
    "moving shadow": pictures(shadow),
    "propeller": pictures(propeller),
    "30 % outliers": lambda samples: samples,
}


@contextmanager
def spoiled_tracks(share: float) -> Iterator[None]:
    """A share of the tracks is somewhere within eight pixels of where it should be, in every frame anew."""
    step = FeatureTracker.step

    def spoiled(
        self: FeatureTracker, image: Image, new_from_previous: NDArray[np.float64] | None = None
    ) -> None:
        step(self, image, new_from_previous)
        rng = np.random.default_rng(self.frame)
        bad = np.arange(len(self.alive)) % 10 < round(share * 10)
        off = rng.uniform(-8, 8, (len(self.alive), 2)) / self.camera.focal_px
        self.history[self.frame % self.HISTORY][bad] += off[bad]

    FeatureTracker.step = spoiled
    try:
        yield
    finally:
        FeatureTracker.step = step


@dataclass(frozen=True)
class Outcome:
    """Of the frames where one plane fills the view: ``errors`` and ``stds`` (n,) in degrees of those with an
    inclination, ``silent`` the words of those without; ``unsafe_flat``: frames called flat that are clearly not."""

    errors: NDArray[np.float64]
    stds: NDArray[np.float64]
    silent: tuple[str, ...]
    unsafe: int
    unsafe_flat: int
    frames: int

    def within(self, sigmas: float, least_deg: float) -> float:
        """Share of the errors within so many of their sigmas, or within a fixed bound."""
        return float((self.errors <= np.maximum(sigmas * self.stds, least_deg)).mean())


def run(cut_name: str, nuisance: str) -> Outcome:
    """Fly a cut under a nuisance and hold it against its truth."""
    source, kept = cut(cut_name)
    samples = NUISANCES[nuisance](list(kept))
    if nuisance == "30 % outliers":
        with spoiled_tracks(0.3):
            estimates = list(_feed(source, samples))
    else:
        estimates = list(_feed(source, samples))
    return _hold(cut_name, estimates)


def _feed(source: ReplaySource, samples: Iterable[Sample]) -> Iterator[SurfaceEstimate]:
    core = Core(source.settings, source.camera, calibrated=source.calibrated, telemetry=source.telemetry)
    for sample in samples:
        yield from (o.estimate for o in core.feed(sample) if isinstance(o, Processed))
    yield from (o.estimate for o in core.finish() if isinstance(o, Processed))


def _hold(cut_name: str, estimates: list[SurfaceEstimate]) -> Outcome:
    truth = truth_of(FLIGHTS / CUTS[cut_name][0])
    row = {int(frame): k for k, frame in enumerate(truth["frame"])}
    errors, stds, silent, unsafe, unsafe_flat = [], [], [], 0, 0
    for estimate in estimates:
        k = row[estimate.frame]
        steep = truth["fit_inclination_deg"][k]
        even = truth["relief"][k] <= EVEN and steep <= LIMIT_DEG - SLOPE_MARGIN_DEG
        if not even and (truth["relief"][k] >= UNEVEN or steep >= LIMIT_DEG + SLOPE_MARGIN_DEG):
            unsafe += 1
            unsafe_flat += estimate.flat
        if truth["plane_fraction"][k] < WHOLE_PLANE:
            continue
        if estimate.status == "ok" and np.isfinite(estimate.inclination_deg):
            errors.append(abs(estimate.inclination_deg - truth["inclination_deg"][k]))
            stds.append(estimate.inclination_std_deg)
        else:
            silent.append(estimate.status)
    return Outcome(np.array(errors), np.array(stds), tuple(silent), unsafe, unsafe_flat, len(estimates))


def main() -> None:
    """Print the table."""
    for cut_name in sys.argv[1:] or CUTS:
        for nuisance in NUISANCES:
            o = run(cut_name, nuisance)
            median, p95 = np.percentile(o.errors, (50, 95)) if len(o.errors) else (np.nan, np.nan)
            sigma = np.median(o.stds) if len(o.stds) else np.nan
            print(
                f"{cut_name:8} {nuisance:25} {median:5.2f} / {p95:5.2f} (sigma {sigma:.2f}), within 3 sigma"
                f" {o.within(3, 0.0):.2f}, or 1 degree {o.within(3, 1.0):.2f}; silent {len(o.silent)}"
                f" of {len(o.errors) + len(o.silent)} {sorted(set(o.silent))}; unsafe called flat {o.unsafe_flat} of"
                f" {o.unsafe}",
                flush=True,
            )


if __name__ == "__main__":
    main()
