"""What a replay reads: a flight folder, or a plain video or folder of images without telemetry."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from companion.core.camera_model import camera_model
from companion.errors import LandslopeError
from companion.replay.log_offset import align_log
from companion.settings.settings import Settings
from companion.settings.settings_file import DEFAULT, load
from drivers.files.autopilot_log import AutopilotLog
from drivers.files.flight_folder import FlightFolder, at_the_start, by_round_trips, log_in
from drivers.files.video_file import open_pictures
from drivers.samples import Sample
from landing.vision.camera import CameraModel

SETTINGS_FILE = "landslope.toml"
ATTITUDES_A_GAP = 2
"""Attitudes that must come within sync.attitude_max_gap_s, so that the loss of one is bridged."""
FLIGHT_FILES = ("frames.csv", "vehicle.tlog", "vehicle.ulg", "vehicle.bin", SETTINGS_FILE)
TLOG_RATE = "a telemetry radio carries no more, record on the companion (record.directory)"
LOG_RATE = "log it faster (ArduPilot: LOG_BITMASK; PX4: SDLOG_PROFILE)"


@dataclass(frozen=True, slots=True)
class PlainCamera:
    """What is said about the camera of a plain video: frame rate, and field of view, focal length or calibration."""

    fps: float | None = None
    fov_deg: float | None = None
    focal_px: float | None = None
    calibration: Path | None = None

    @property
    def given(self) -> bool:
        """Whether anything was said."""
        return self != PlainCamera()


@dataclass(frozen=True, slots=True)
class ReplaySource:
    """An input ready to be run: its settings, its camera and its samples in order of arrival."""

    settings: Settings
    camera: CameraModel
    calibrated: bool
    telemetry: bool
    frame_count: int | None
    samples: Callable[[], Iterator[Sample]]
    cautions: tuple[str, ...] = ()
    """What of the recording is unfit for a good replay, in words."""


def flights_in(path: Path) -> list[Path]:
    """The flight itself, or the flight folders in a folder of flights, by name; LandslopeError if it cannot be read."""
    if not path.is_dir() or _is_flight(path):
        return [path]
    try:
        children = sorted(path.iterdir())
        flights = [child for child in children if child.is_dir() and _is_flight(child)]
    except OSError as error:
        raise LandslopeError(f"{path}: cannot be read: {error.strerror}; check its rights") from None
    return flights or [path]


def _is_flight(path: Path) -> bool:
    return any((path / name).exists() for name in FLIGHT_FILES)


def open_source(
    path: Path, config: Path | None, overrides: tuple[str, ...], plain: PlainCamera
) -> ReplaySource:
    """Open a flight folder, a video file or a folder of images."""
    if path.is_dir() and _is_flight(path):
        return _flight(path, config, overrides, plain)
    return _pictures(path, config, overrides, plain)


def _flight(path: Path, config: Path | None, overrides: tuple[str, ...], plain: PlainCamera) -> ReplaySource:
    if plain.given:
        raise LandslopeError(
            f"{path}: --fps, --fov-deg, --focal-px and --calibration are for plain videos; a flight has its own "
            "frames.csv and camera.calibration (--set camera.calibration=FILE)"
        )
    own = path / SETTINGS_FILE
    loaded = load(config or (own if own.exists() else None), overrides)
    settings = loaded.settings
    beside = path / "camera.yaml"
    if loaded.origins["camera.calibration"] == DEFAULT and beside.exists():
        settings = replace(settings, camera=replace(settings.camera, calibration=str(beside)))
    log = log_in(path)
    if log is None:
        folder = FlightFolder(path, settings.vehicle.system_id, settings.mavlink.autopilot_component)
        cautions = tuple(_cautions(folder, settings, TLOG_RATE))
    else:
        folder, found = _with_log(log, path, settings)
        cautions = (*found, *_cautions(folder, settings, LOG_RATE))
    camera, calibrated = camera_model(settings.camera, folder.width, folder.height)
    return ReplaySource(settings, camera, calibrated, True, folder.frame_count, folder.samples, cautions)


def _with_log(log: AutopilotLog, path: Path, settings: Settings) -> tuple[FlightFolder, tuple[str, ...]]:
    """The flight with its autopilot's log in the companion's time, and what is to be said of that time."""
    in_time = by_round_trips(log, path)
    if in_time is not None:
        return FlightFolder(path, telemetry=in_time), ()
    folder = FlightFolder(path, telemetry=at_the_start(log, path))
    camera, _ = camera_model(settings.camera, folder.width, folder.height)
    found = align_log(log.attitudes, folder.frames(), camera, settings.tracking)
    offset_us = found.offset_us - round(settings.camera.time_offset_s * 1e6)
    said = (
        f"{log.name} has no TIMESYNC round trips with the clock of the frames: aligned by the rotation in "
        f"{found.pairs} pairs of frames to {found.std_s * 1e3:.1f} ms (one sigma)"
    )
    return FlightFolder(path, telemetry=log.by_offset(offset_us, found.std_s)), (said,)


def _cautions(folder: FlightFolder, settings: Settings, remedy: str) -> Iterator[str]:
    gap_s, rate_hz = settings.sync.attitude_max_gap_s, folder.attitude_hz
    if rate_hz and rate_hz * gap_s < ATTITUDES_A_GAP:
        yield (
            f"attitude was recorded at {rate_hz:.2g} Hz: the slope to gravity needs {ATTITUDES_A_GAP / gap_s:.0f} Hz "
            f"or more; {remedy}"
        )


def _pictures(
    path: Path, config: Path | None, overrides: tuple[str, ...], plain: PlainCamera
) -> ReplaySource:
    settings = load(config, overrides).settings
    if plain.calibration is not None:
        settings = replace(settings, camera=replace(settings.camera, calibration=str(plain.calibration)))
    pictures = open_pictures(path)
    camera, calibrated = camera_model(
        settings.camera, pictures.width, pictures.height, fov_deg=plain.fov_deg, focal_px=plain.focal_px
    )
    count = pictures.frame_count or None
    return ReplaySource(settings, camera, calibrated, False, count, lambda: pictures.frames(plain.fps))
