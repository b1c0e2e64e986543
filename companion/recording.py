"""When a flight is recorded, and the papers that go with it."""

import dataclasses
from pathlib import Path

from companion.check_command import in_force
from companion.settings import RecordSettings
from companion.settings_file import LoadedSettings
from drivers.flight_folder import CALIBRATION
from drivers.recorder import FlightPapers, RecorderOptions

US_PER_S = 1_000_000
BYTES_PER_MB = 1_000_000


class RecordingSwitch:
    """Says whether to record now: with arming, always, or by hand.

    A word by hand holds until the vehicle arms or disarms the next time; under "manual" and "always" for good.
    """

    def __init__(self, settings: RecordSettings) -> None:
        self._settings = settings
        self._by_hand: bool | None = None
        self._armed: bool | None = None
        self._last_armed_us: int | None = None

    def by_hand(self, record: bool) -> None:
        """Start (True) or stop (False) on the user's word."""
        self._by_hand = record

    def step(self, time_us: int, armed: bool | None) -> bool:
        """Whether to record at ``time_us``; ``armed`` None: not known, so that nothing changes."""
        if armed is not None and armed != self._armed:
            if self._armed is not None and self._settings.when == "armed":
                self._by_hand = None
            self._armed = armed
        if self._armed:
            self._last_armed_us = time_us
        if not self._settings.directory:
            return False
        if self._by_hand is not None:
            return self._by_hand
        if self._settings.when != "armed":
            return self._settings.when == "always"
        if self._last_armed_us is None:
            return False
        return time_us - self._last_armed_us <= self._settings.after_disarm_s * US_PER_S


def recorder_options(settings: RecordSettings, rate_hz: float) -> RecorderOptions:
    """The recorder's options; ``rate_hz`` the camera's nominal rate."""
    return RecorderOptions(
        directory=Path(settings.directory),
        jpeg_quality=settings.jpeg_quality,
        rate_hz=rate_hz,
        max_flight_bytes=settings.max_flight_mb * BYTES_PER_MB,
        min_free_bytes=settings.min_free_mb * BYTES_PER_MB,
    )


def flight_papers(loaded: LoadedSettings) -> FlightPapers:
    """The settings in force, with the calibration beside them under the name that flights use."""
    calibration = Path(loaded.settings.camera.calibration)
    text = calibration.read_text(encoding="utf-8") if calibration.is_file() else ""
    camera = dataclasses.replace(loaded.settings.camera, calibration=CALIBRATION if text else "")
    flown = dataclasses.replace(loaded, settings=dataclasses.replace(loaded.settings, camera=camera))
    return FlightPapers(settings="\n".join(in_force(flown)) + "\n", calibration=text)
