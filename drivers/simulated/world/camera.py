"""The simulated camera: poses in, frames with the sensor's faults out, and the truth of every frame."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError
from drivers.samples import Frame
from drivers.simulated.world.in_view import InView, Seen
from drivers.simulated.world.render import Renderer
from drivers.simulated.world.truth import FrameTruth, frame_truth

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Pose:
    """Where the vehicle is: ``position`` (3,) NED m, ``ned_from_body`` (3, 3), ``velocity`` (3,) NED m/s."""

    position: Array
    ned_from_body: Array
    velocity: Array


Trajectory = Callable[[float], Pose]
"""Pose at a time in seconds (the autopilot's time since boot)."""


@dataclass(frozen=True)
class SensorOptions:
    """The sensor's faults; all off but the noise. ``exposure_s`` blurs by motion, averaged over ``blur_samples`` poses;
    ``readout_s`` is the rolling shutter's time from the first row to the last.
    """

    noise_sigma: float = 2.0
    """Standard deviation of the noise, grey levels."""
    vignetting: float = 0.0
    """Loss of light in the corners, 0 to 1."""
    exposure_drift: float = 0.0
    """Amplitude of the slow relative change of brightness."""
    exposure_period_s: float = 7.0
    exposure_s: float = 0.0
    blur_samples: int = 4
    readout_s: float = 0.0
    brightness: float = 1.0
    contrast: float = 1.0
    """Scales grey values about 128."""
    in_view: str = "nothing"
    """What is in the picture beside the ground, one of ``in_view.IN_VIEW``."""

    def __post_init__(self) -> None:
        for name, low, high in (
            ("noise_sigma", 0, 50),
            ("vignetting", 0, 1),
            ("exposure_drift", 0, 0.9),
            ("exposure_period_s", 0.1, 1e6),
            ("exposure_s", 0, 0.1),
            ("blur_samples", 1, 64),
            ("readout_s", 0, 0.1),
            ("brightness", 0, 4),
            ("contrast", 0, 4),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise DriverError(
                    f"the simulated camera's {name} must lie between {low} and {high}, got {value}"
                )


class SimulatedCamera:
    """Exposes frames along a trajectory. Deterministic: frame ``n`` has the same noise whenever it is taken."""

    def __init__(self, renderer: Renderer, options: SensorOptions | None = None, seed: int = 1) -> None:
        self.renderer = renderer
        self.options = SensorOptions() if options is None else options
        self.seed = seed
        lens = renderer.lens
        nothing = self.options.in_view == "nothing"
        self._in_view = None if nothing else InView(self.options.in_view, lens, seed)
        y, x = np.mgrid[0 : lens.height, 0 : lens.width]
        radius2 = (x - lens.matrix[0, 2]) ** 2 + (y - lens.matrix[1, 2]) ** 2
        self._vignette = (1 - self.options.vignetting * radius2 / radius2.max()).astype(np.float32)

    def expose(self, number: int, time_s: float, trajectory: Trajectory) -> NDArray[np.uint8]:
        """(height, width) uint8: frame ``number``, its middle row's mid-exposure at ``time_s``."""
        o = self.options
        self.renderer.world.advance(time_s)
        if o.exposure_s > 0:
            offsets = ((np.arange(o.blur_samples) + 0.5) / o.blur_samples - 0.5) * o.exposure_s
            light = sum(self._instant(time_s + float(t), trajectory) for t in offsets) / np.float32(
                o.blur_samples
            )
        else:
            light = self._instant(time_s, trajectory)
        if self._in_view is not None:
            light = self._in_view.draw(np.asarray(light, np.float32), self._seen(trajectory(time_s)), time_s)
        drift = 1 + o.exposure_drift * math.sin(2 * math.pi * time_s / o.exposure_period_s + self.seed)
        picture = (128 + o.contrast * (light - 128)) * (self._vignette * np.float32(o.brightness * drift))
        if o.noise_sigma > 0:
            rng = np.random.Generator(np.random.SFC64([self.seed, number]))
            picture += np.float32(o.noise_sigma) * rng.standard_normal(picture.shape, dtype=np.float32)
        return np.clip(np.rint(picture), 0, 255).astype(np.uint8)

    def truth(self, number: int, time_s: float, trajectory: Trajectory) -> FrameTruth:
        """The truth of the frame at its middle."""
        self.renderer.world.advance(time_s)
        pose = trajectory(time_s)
        return frame_truth(self.renderer, number, time_s, pose.position, pose.ned_from_body, pose.velocity)

    def frames(
        self,
        trajectory: Trajectory,
        start_s: float,
        count: int,
        rate_hz: float = 30.0,
        latency_s: float = 0.0,
    ) -> Iterator[tuple[Frame, FrameTruth]]:
        """``count`` frames with their truth; stamped at mid-exposure, arriving ``latency_s`` later."""
        if rate_hz <= 0:
            raise DriverError(f"the frame rate must be positive, got {rate_hz}")
        for number in range(count):
            time_s = start_s + number / rate_hz
            stamp = round(time_s * 1e6)
            image = self.expose(number, time_s, trajectory)
            yield (
                Frame(number, stamp, stamp + round(latency_s * 1e6), image),
                self.truth(number, time_s, trajectory),
            )

    def _seen(self, pose: Pose) -> Seen:
        """The camera at a pose, and what of it a shadow needs."""
        north, east, down = pose.position.tolist()
        height_m = -down - self.renderer.world.height_at(north, east)
        heading = math.atan2(pose.ned_from_body[1, 0], pose.ned_from_body[0, 0])
        mount = self.renderer.lens.body_from_camera
        return Seen(pose.position, pose.ned_from_body @ mount, heading, max(height_m, 0.05))

    def _instant(self, time_s: float, trajectory: Trajectory) -> NDArray[np.float32]:
        renderer, o = self.renderer, self.options
        mount = renderer.lens.body_from_camera
        if o.readout_s == 0:
            pose = trajectory(time_s)
            return renderer.image(pose.position, pose.ned_from_body @ mount)
        height = renderer.lens.height
        times = time_s + (np.arange(height) / (height - 1) - 0.5) * o.readout_s
        poses = [trajectory(float(t)) for t in times]
        positions = np.stack([p.position for p in poses])
        rotations = np.stack([p.ned_from_body for p in poses]) @ mount
        return renderer.rows(positions, rotations)
