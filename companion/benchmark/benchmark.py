"""What a frame costs: the pipeline, stage by stage, beside OpenCV's corner detection and tracking of the same frames.

Times are processor time of one core. Both sides take each frame in turn, so that a busy machine slows both alike. The
stages are timed in a run of their own, since a stopwatch at every stage slows the whole.
"""

import copy
import gc
import itertools
import os
import statistics
import time
import tracemalloc
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import landing.pipeline
import landing.plane.map_estimator
from companion.core.core import observation_of
from companion.core.sync import Synchroniser
from companion.errors import LandslopeError
from companion.replay.source import PlainCamera, open_source
from landing.ground.border import Border
from landing.ground.ground import Ground
from landing.ground.relief_memory import ReliefMemory
from landing.ground.roughness import ReliefMap
from landing.motion.fixed_parts import FixedParts
from landing.observation import Observation
from landing.options import Options
from landing.pipeline import SurfacePipeline
from landing.plane.evidence import Evidence
from landing.plane.map_estimator import MapEstimator
from landing.plane.quadratic import QuadraticEstimator
from landing.vision.camera import CameraModel
from landing.vision.tracking import FeatureTracker

WARM_UP = 10
"""First frames of a run that do not count."""
FEWEST = WARM_UP + 5
CORNERS = 150
QUALITY, DISTANCE_PX = 0.01, 7
WINDOW_PX, LEVELS = 21, 3
"""OpenCV's own defaults of calcOpticalFlowPyrLK."""

STAGES: dict[str, tuple[tuple[Any, str], ...]] = {
    "prepare and track": ((FeatureTracker, "_prepared"), (FeatureTracker, "_follow")),
    "place corners": ((FeatureTracker, "_place"),),
    "choose the baseline": ((MapEstimator, "_choose"),),
    "fit": ((MapEstimator, "_fit"), (QuadraticEstimator, "step")),
    "motion": ((landing.plane.map_estimator, "velocity"),),
    "evidence": ((Evidence, "add"), (Evidence, "fuse")),
    "relief": ((ReliefMemory, "move"), (ReliefMap, "step")),
    "border": ((Border, "step"),),
    "decision": ((landing.pipeline, "against_flat"),),
    "ground map": ((Ground, "step"),),
    "still parts": ((FixedParts, "step"),),
}
"""Stage -> where it is called: (class or module, name)."""
NOT_EVEN = ("ground map", "still parts")
"""Stages that do most of their work in a few of the frames: their means count."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Median of one stage over the frames in which it ran, in ms, their share of all frames, and the mean over all."""

    median_ms: float
    share: float
    mean_ms: float


@dataclass(frozen=True, slots=True)
class Figures:
    """One size of image: times in ms a frame, growth of memory over the second half of a run in kB."""

    width: int
    height: int
    frames: int
    detection_ms: float
    tracking_ms: float
    opencv_ms: float
    stages: dict[str, Stage]
    rest_ms: float
    whole_ms: float
    whole_mean_ms: float
    ratio: float
    """Median of the whole pipeline over the median of OpenCV's part."""
    traced_growth_kb: float
    resident_growth_kb: float
    ground_kb: float
    """What the ground map and the search for still parts hold at the end of a run."""


@dataclass(frozen=True, slots=True)
class Material:
    """Frames of one size with their attitudes, and how they are to be seen."""

    camera: CameraModel
    options: Options
    observations: list[Observation]


def read(path: Path, start: int, frames: int, overrides: tuple[str, ...] = ()) -> Material:
    """Frames ``start`` to ``start + frames`` of a flight, with attitudes as the daemon would have them."""
    source = open_source(path, None, overrides, PlainCamera())
    sync = Synchroniser(source.settings, source.telemetry)
    ready = (r for sample in source.samples() for r in sync.feed(sample)[0])
    found = [observation_of(r) for r in itertools.islice(ready, start, start + frames)]
    if len(found) < FEWEST:
        raise LandslopeError(
            f"{path}: {len(found)} frames behind frame {start}, at least {FEWEST} are measured: lower --start"
        )
    s = source.settings
    tracking = replace(s.tracking, max_features=CORNERS)
    return Material(source.camera, Options(tracking, s.estimator, s.decision), found)


def resized(material: Material, width: int, height: int) -> Material:
    """The same frames at another size, with a camera to match."""
    camera = material.camera
    if (width, height) == (camera.width, camera.height):
        return material
    model = camera.resized(width, height)
    how = cv2.INTER_AREA if width < camera.width else cv2.INTER_CUBIC
    images = (cv2.resize(o.image, (width, height), interpolation=how) for o in material.observations)
    observations = [
        replace(o, image=np.asarray(image, np.uint8))
        for o, image in zip(material.observations, images, strict=True)
    ]
    return Material(model, material.options, observations)


def measure(material: Material) -> Figures:
    """Run the pipeline and OpenCV's part over the frames, one frame each in turn."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        detection, tracking, whole = _compared(material)
        watched, stages = _staged(material)
        traced, resident, ground_kb = _growth(material)
    finally:
        cv2.setNumThreads(threads)
    opencv_ms = statistics.median(d + t for d, t in zip(detection, tracking, strict=True))
    whole_ms = statistics.median(whole)
    in_stages = [sum(times[i] for times in stages.values()) for i in range(len(watched))]
    return Figures(
        material.camera.width,
        material.camera.height,
        len(whole),
        statistics.median(detection),
        statistics.median(tracking),
        opencv_ms,
        {name: _stage(times) for name, times in stages.items()},
        statistics.median(w - s for w, s in zip(watched, in_stages, strict=True)),
        whole_ms,
        statistics.fmean(whole),
        whole_ms / opencv_ms,
        traced,
        resident,
        ground_kb,
    )


def table(figures: list[Figures]) -> str:
    """The figures as text: one row a stage, one column a size."""

    def row(name: str, values: list[str]) -> str:
        return f"{name:<34}" + "".join(f"{value:>18}" for value in values)

    lines = [
        row("ms of one core, medians", [f"{f.width} x {f.height}" for f in figures]),
        row("OpenCV: detect 150 corners", [f"{f.detection_ms:.2f}" for f in figures]),
        row("OpenCV: track them", [f"{f.tracking_ms:.2f}" for f in figures]),
        row("OpenCV alone", [f"{f.opencv_ms:.2f}" for f in figures]),
    ]
    for name in STAGES:
        lines.append(row(name, [_cell(f.stages[name]) for f in figures]))
    for name in NOT_EVEN:
        lines.append(row(f"{name}, mean", [f"{f.stages[name].mean_ms:.2f}" for f in figures]))
    lines += [
        row("rest", [f"{f.rest_ms:.2f}" for f in figures]),
        row("whole pipeline", [f"{f.whole_ms:.2f}" for f in figures]),
        row("whole pipeline, mean", [f"{f.whole_mean_ms:.2f}" for f in figures]),
        row("whole pipeline / OpenCV alone", [f"{f.ratio:.2f}" for f in figures]),
        row("frames/s of this core, OpenCV", [f"{1e3 / f.opencv_ms:.0f}" for f in figures]),
        row("frames/s of this core, pipeline", [f"{1e3 / f.whole_mean_ms:.0f}" for f in figures]),
        row("growth of memory, Python's, kB", [f"{f.traced_growth_kb:+.1f}" for f in figures]),
        row("growth of memory, resident, kB", [f"{f.resident_growth_kb:+.0f}" for f in figures]),
        row("memory of both, kB", [f"{f.ground_kb:.0f}" for f in figures]),
        row("frames", [str(f.frames) for f in figures]),
    ]
    return "\n".join(lines)


def _cell(stage: Stage) -> str:
    if not stage.share:
        return "did not run"
    often = "" if stage.share > 0.995 else f" ({stage.share:.0%})"
    return f"{stage.median_ms:.2f}{often}"


def _stage(times: list[float]) -> Stage:
    ran = [t for t in times if t > 0]
    return Stage(statistics.median(ran) if ran else 0.0, len(ran) / len(times), statistics.fmean(times))


class _Stopwatch:
    """Time spent in the stages since the last ``lap``; what runs inside of another stage counts once, inside."""

    def __init__(self) -> None:
        self._spent_ns: dict[str, int] = defaultdict(int)
        self._inner_ns = [0]

    def wrapped(self, stage: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """``function``, timed."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner_ns.append(0)
            started = time.process_time_ns()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.process_time_ns() - started
                self._spent_ns[stage] += took - self._inner_ns.pop()
                self._inner_ns[-1] += took

        return timed

    def lap(self) -> dict[str, float]:
        """Milliseconds of each stage."""
        spent = {stage: self._spent_ns[stage] * 1e-6 for stage in STAGES}
        self._spent_ns.clear()
        return spent

    @contextmanager
    def watching(self) -> Iterator[None]:
        """While this lasts, the stages are timed wherever they are called."""
        places = [(stage, *place) for stage, found in STAGES.items() for place in found]
        originals = [(owner, name, getattr(owner, name)) for _, owner, name in places]
        try:
            for (stage, owner, name), (_, _, original) in zip(places, originals, strict=True):
                setattr(owner, name, self.wrapped(stage, original))
            yield
        finally:
            for owner, name, original in originals:
                setattr(owner, name, original)


Times = list[float]


def _compared(material: Material) -> tuple[Times, Times, Times]:
    """Detection, tracking and the whole pipeline, ms a frame, without the first frames."""
    pipeline = _pipeline(material)
    detection, tracking, whole = [], [], []
    gc.collect()
    pipeline.step(material.observations[0])
    for before, now in itertools.pairwise(material.observations):
        started = time.process_time_ns()
        pipeline.step(now)
        whole.append((time.process_time_ns() - started) * 1e-6)
        detect_ms, track_ms = _opencv(before.image, now.image)
        detection.append(detect_ms)
        tracking.append(track_ms)
    return detection[WARM_UP:], tracking[WARM_UP:], whole[WARM_UP:]


def _staged(material: Material) -> tuple[Times, dict[str, Times]]:
    """The whole pipeline with a stopwatch at each stage, and each stage, ms a frame, without the first frames."""
    pipeline = _pipeline(material)
    whole: Times = []
    stages: dict[str, Times] = {stage: [] for stage in STAGES}
    watch = _Stopwatch()
    gc.collect()
    with watch.watching():
        pipeline.step(material.observations[0])
        for observation in material.observations[1:]:
            watch.lap()
            started = time.process_time_ns()
            pipeline.step(observation)
            whole.append((time.process_time_ns() - started) * 1e-6)
            for stage, ms in watch.lap().items():
                stages[stage].append(ms)
    return whole[WARM_UP:], {stage: times[WARM_UP:] for stage, times in stages.items()}


def _opencv(before: NDArray[np.uint8], now: NDArray[np.uint8]) -> tuple[float, float]:
    """Milliseconds of finding corners in one frame, and of following them into the next."""
    started = time.process_time_ns()
    corners = cv2.goodFeaturesToTrack(before, CORNERS, QUALITY, DISTANCE_PX)
    found = time.process_time_ns()
    if corners is not None:
        size = (WINDOW_PX, WINDOW_PX)
        # OpenCV's stubs do not know that the result may be left out
        cv2.calcOpticalFlowPyrLK(before, now, corners, None, winSize=size, maxLevel=LEVELS)  # type: ignore[call-overload]
    return (found - started) * 1e-6, (time.process_time_ns() - found) * 1e-6


def _pipeline(material: Material) -> SurfacePipeline:
    """As the core has it; masks that it finds go to a camera of its own."""
    pipeline = SurfacePipeline(copy.copy(material.camera), material.options)
    pipeline.find_fixed()
    return pipeline


def _growth(material: Material) -> tuple[float, float, float]:
    """kB by which Python's and the process's memory grow from the middle to the end of a run, and what the ground map
    and the search for still parts hold then."""
    pipeline = _pipeline(material)
    half = len(material.observations) // 2
    tracemalloc.start(1)
    try:
        for observation in material.observations[:half]:
            pipeline.step(observation)
        middle = _memory()
        for observation in material.observations[half:]:
            pipeline.step(observation)
        end = _memory()
        del pipeline.ground, pipeline.fixed
        held = end[0] - _memory()[0]
    finally:
        tracemalloc.stop()
    return (end[0] - middle[0]) / 1e3, (end[1] - middle[1]) / 1e3, held / 1e3


def _memory() -> tuple[int, int]:
    """Bytes that Python's allocations hold, and bytes resident."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return tracemalloc.get_traced_memory()[0], pages * os.sysconf("SC_PAGE_SIZE")
