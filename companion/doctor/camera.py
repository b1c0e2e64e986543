"""The camera before a flight: does it open, how fast and even is it, is the picture sharp, lit and textured."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.core.camera_model import camera_model
from companion.core.health import LARGE_MASK
from companion.doctor.findings import DoctorOptions, Finding, Level
from companion.errors import LandslopeError
from companion.live.kept_mask import KeptMask
from companion.settings.settings import Settings
from drivers.cameras import Camera, CameraFormat, ReaderLimits, open_camera
from drivers.errors import DriverError
from drivers.files.picture_mask import read_mask
from drivers.samples import Frame, Refusal
from landing.vision.tracking import FeatureTracker

WHITE, BLACK = 250, 5
BLUR_PX = 9
"""Side of the filter that a picture is blurred by to see whether it was sharp."""


class CameraExamination:
    """Watches the camera for a while; ``look`` often, ``findings`` at the end."""

    def __init__(self, settings: Settings, options: DoctorOptions) -> None:
        self._settings, self._options = settings, options
        self._frames: list[tuple[int, int]] = []
        self._image: NDArray[np.uint8] | None = None
        self._refused: list[Refusal] = []
        self._fault = ""
        self._camera: Camera | None = None
        c = settings.camera
        wanted = CameraFormat(
            c.width, c.height, c.rate_hz, c.exposure_us, c.gain, c.pixel_format, c.transport
        )
        try:
            limits = ReaderLimits(open_timeout_s=c.open_timeout_s, read_timeout_s=c.read_timeout_s)
            self._camera = open_camera(c.source, wanted, limits)
        except DriverError as error:
            self._fault = str(error)

    def look(self, wait_s: float) -> None:
        """Take what came, waiting up to ``wait_s``."""
        if self._camera is None:
            return
        for sample in self._camera.read(wait_s):
            if isinstance(sample, Frame):
                self._frames.append((sample.stamp_us, sample.arrival_us))
                self._image = sample.image
            else:
                self._refused.append(sample)

    def close(self) -> None:
        """Give the camera back."""
        if self._camera is not None:
            self._camera.close()

    def findings(self) -> list[Finding]:
        """Everything about the camera."""
        status = self._camera.status() if self._camera is not None else None
        if self._image is None or len(self._frames) < 3:
            fault = self._fault or (status.problem if status is not None else "") or "no frame came"
            remedy = (status.remedy if status is not None else "") or "check cable, power and camera.source"
            return [Finding("camera", "failure", fault, remedy)]
        findings = [self._opened(), self._rate(), self._exposure(), self._sharpness(), self._calibration()]
        findings += self._mask()
        if self._refused:
            reasons = sorted({refusal.reason.words for refusal in self._refused})
            text = f"{len(self._refused)} frames refused: {', '.join(reasons)}"
            findings.append(
                Finding("frames", "warning", text, "look at the camera's settings and its driver")
            )
        if status is not None and status.reopened:
            text = (
                f"had to be opened again {status.reopened} times: {status.problem or 'it stopped in between'}"
            )
            findings.append(Finding("camera", "warning", text, "check cable, power supply and network"))
        return findings

    def _opened(self) -> Finding:
        height, width = self._image.shape if self._image is not None else (0, 0)
        return Finding("camera", "ok", f"{self._settings.camera.source} gives {width} x {height}")

    def _rate(self) -> Finding:
        """From the stamps: what was skipped here does not count against the camera."""
        o, asked_hz = self._options, self._settings.camera.rate_hz
        stamps, arrivals = np.array(self._frames, np.int64).T
        steps = np.diff(stamps)
        period_us = float(np.median(steps))
        rate_hz = 1e6 / period_us
        single = steps[steps < 1.5 * period_us]
        jitter = float(single.std()) / period_us
        latency_s = float(np.median(arrivals - stamps)) * 1e-6
        text = f"{rate_hz:.1f} Hz, intervals even to {jitter:.0%}, {latency_s * 1e3:.0f} ms from capture to arrival"
        if asked_hz and rate_hz < o.rate_share * asked_hz:
            return Finding(
                "frame rate",
                "warning",
                f"{text}; asked for {asked_hz:g} Hz",
                "shorter exposure, or another format",
            )
        if rate_hz < o.min_frame_rate_hz:
            return Finding(
                "frame rate", "warning", text, f"set camera.rate_hz to {o.min_frame_rate_hz:g} or more"
            )
        if jitter > o.max_frame_jitter:
            return Finding("frame rate", "warning", text, "a network camera: wire it; USB: a port of its own")
        if latency_s > o.max_latency_s:
            return Finding(
                "frame rate", "warning", text, "less buffering at the sender; calibrate --time-offset"
            )
        return Finding("frame rate", "ok", text)

    def _exposure(self) -> Finding:
        image = self._image
        assert image is not None
        white, black = float((image >= WHITE).mean()), float((image <= BLACK).mean())
        contrast = float(image.std())
        fixed = self._settings.camera.exposure_us
        text = (
            f"mean {image.mean():.0f} of 255, {white:.0%} white, {black:.0%} black, contrast {contrast:.0f}, "
        )
        text += f"exposure {fixed} us" if fixed else "exposure automatic"
        if white > self._options.max_saturated:
            return Finding("exposure", "warning", text, "shorter camera.exposure_us or less camera.gain")
        if black > self._options.max_saturated:
            return Finding("exposure", "warning", text, "light, more camera.gain, or is the lens covered?")
        if contrast < self._options.min_contrast:
            return Finding(
                "exposure", "warning", text, "nothing to be seen: is the lens covered, the ground bare?"
            )
        return Finding("exposure", "ok", text)

    def _sharpness(self) -> Finding:
        image = self._image
        assert image is not None
        blur = blur_of(image)
        try:
            camera, _ = camera_model(self._settings.camera, image.shape[1], image.shape[0], fov_deg=60.0)
            tracker = FeatureTracker(camera, self._settings.tracking)
            tracker.step(image)
            corners = int(tracker.alive.sum())
        except LandslopeError as error:
            return Finding("sharpness", "failure", str(error))
        text = f"blur {blur:.2f} (0 is sharp), {corners} corners to follow"
        if blur > self._options.max_blur:
            return Finding(
                "sharpness",
                "warning",
                text,
                "focus the lens for the flying height, clean it, expose shorter",
            )
        level: Level = "ok" if corners >= self._options.min_corners else "warning"
        remedy = (
            ""
            if level == "ok"
            else "over ground with texture there must be more: check focus, light and exposure"
        )
        return Finding("sharpness", level, text, remedy)

    def _mask(self) -> list[Finding]:
        """What of the picture does not show the ground: as set, and as earlier flights found."""
        image, camera = self._image, self._settings.camera
        assert image is not None
        height, width = image.shape
        try:
            given = read_mask(Path(camera.mask), width, height) if camera.mask else None
        except DriverError as error:
            return [Finding("mask", "failure", str(error))]
        kept = KeptMask(camera)
        found = kept.load(width, height) if camera.learn_mask else None
        texts = [] if given is None else [f"camera.mask covers {given.mean():.0%} of the picture"]
        texts += [] if found is None else [f"{found.mean():.0%} stood still in earlier flights ({kept.path})"]
        if not texts:
            return []
        masks = [mask for mask in (given, found) if mask is not None]
        share = float(np.logical_or.reduce(masks).mean())
        if share > LARGE_MASK:
            remedy = "move the camera, clean the lens, or delete the file if it is of another vehicle"
            return [Finding("mask", "warning", "; ".join(texts), remedy)]
        return [Finding("mask", "ok", "; ".join(texts))]

    def _calibration(self) -> Finding:
        image = self._image
        assert image is not None
        try:
            model, calibrated = camera_model(self._settings.camera, image.shape[1], image.shape[0])
        except (LandslopeError, DriverError) as error:
            return Finding("calibration", "failure", str(error))
        if not calibrated:
            return Finding(
                "calibration", "warning", "none: slopes will be rough", "run 'landslope calibrate'"
            )
        middle = (image.shape[0] - 1) / 2
        left, right = model.undistort(np.array(((0.0, middle), (image.shape[1] - 1.0, middle))))[:, 0]
        across = np.degrees(np.arctan(right) - np.arctan(left))
        text = f"{self._settings.camera.calibration} fits, {across:.0f} degrees across"
        offset_s = self._settings.camera.time_offset_s
        offset = f"{offset_s * 1e3:+.1f} ms" if offset_s else "0 (calibrate --time-offset measures it)"
        text = f"{text}; time offset {offset}"
        if model.readout_s is None:
            remedy = "set camera.readout_s: 0 for a global shutter, else see docs/calibration.md"
            return Finding("calibration", "warning", f"{text}; rolling shutter readout not set", remedy)
        return Finding("calibration", "ok", f"{text}; readout {model.readout_s * 1e3:.1f} ms")


def blur_of(image: NDArray[np.uint8]) -> float:
    """How blurred a picture is, 0 (sharp) to 1: what a strong blur takes from its differences (Crete et al., 2007)."""
    grey = image.astype(np.float32)
    worst = 0.0
    for axis, size in ((0, (1, BLUR_PX)), (1, (BLUR_PX, 1))):
        own = np.abs(np.diff(grey, axis=axis))
        blurred = np.abs(np.diff(cv2.blur(grey, size), axis=axis))
        total = float(own.sum())
        lost = float(np.maximum(0, own - blurred).sum())
        worst = max(worst, (total - lost) / total if total > 0 else 1.0)
    return worst
