"""When a flight is recorded, and the papers that go with it."""

import dataclasses
import importlib.util
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from companion.core.core import Processed
from companion.errors import LandslopeError
from companion.messages.conditions import Code, Condition, condition
from companion.messages.messages import Message, encode, topic_of
from companion.settings.masking import without_secrets
from companion.settings.settings import RecordSettings, Settings
from companion.settings.settings_file import entries, value_of
from companion.settings.toml_text import written
from drivers.events import DriverEvent
from drivers.files.flight_folder import CALIBRATION
from drivers.files.recorder import FlightPapers, Recorder, RecorderOptions
from drivers.samples import Frame, Heartbeat, Sample

if TYPE_CHECKING:
    from companion.export.live_recording import LiveMcap

US_PER_S = 1_000_000
BYTES_PER_MB = 1_000_000
DEFAULT_RATE_HZ = 30.0
"""Rate of the recorded video when none is asked of the camera; the true times stand in frames.csv."""


def _live_mcap(settings: Settings) -> "LiveMcap":
    if importlib.util.find_spec("foxglove") is None:
        raise LandslopeError("record.mcap needs the extra 'record': pip install 'landslope[record]'")
    from companion.export.live_recording import LiveMcap  # heavy, and only on boards that want it

    return LiveMcap(settings)


class RecordingSwitch:
    """Says whether to record now: with arming, always, or by hand.

    A word by hand holds until the vehicle arms or disarms the next time; under "manual" and "always" for good.
    """

    def __init__(self, settings: RecordSettings) -> None:
        self._settings = settings
        self._by_hand: bool | None = None
        self._armed: bool | None = None
        self._last_armed_us: int | None = None

    def set_settings(self, settings: RecordSettings) -> None:
        """Other settings from now on; what was said by hand holds."""
        self._settings = settings

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
        max_total_bytes=settings.max_total_mb * BYTES_PER_MB,
        delete_oldest=settings.when_full == "delete_oldest",
    )


def flight_papers(settings: Settings) -> FlightPapers:
    """The settings in force without their secrets, with the calibration beside them under the name that flights use."""
    calibration = Path(settings.camera.calibration)
    text = calibration.read_text(encoding="utf-8") if calibration.is_file() else ""
    camera = dataclasses.replace(settings.camera, calibration=CALIBRATION if text else "")
    shown = without_secrets(dataclasses.replace(settings, camera=camera))
    return FlightPapers(settings=_toml(shown), calibration=text)


def _toml(settings: Settings) -> str:
    lines = ["# The settings this flight was flown with."]
    section = ""
    for entry in entries():
        head, _, name = entry.path.rpartition(".")
        if head != section:
            lines += ["", f"[{head}]"]
            section = head
        lines.append(f"{name} = {written(value_of(settings, entry.path))}")
    return "\n".join(lines) + "\n"


def _options_and_papers(settings: Settings) -> tuple[RecorderOptions, FlightPapers]:
    rate_hz = settings.camera.rate_hz or DEFAULT_RATE_HZ
    return recorder_options(settings.record, rate_hz), flight_papers(settings)


def _recorder(settings: Settings) -> Recorder:
    return Recorder(*_options_and_papers(settings))


class FlightRecording:
    """A recorder wired to the settings: it receives everything and keeps what belongs to a flight.

    ``mavlink`` may be called from any thread, the rest from one. Without ``record.directory`` nothing happens.
    """

    def __init__(self, settings: Settings) -> None:
        self._switch = RecordingSwitch(settings.record)
        self._armed: bool | None = None
        self._wanted = False
        self._recorder = _recorder(settings) if settings.record.directory else None
        self._mcap = _live_mcap(settings) if self._recorder is not None and settings.record.mcap else None
        self._folder_before: Path | None = None

    def set_settings(self, settings: Settings) -> None:
        """Other settings from now on; where they change, a flight goes on in a new folder."""
        self._switch.set_settings(settings.record)
        if self._recorder is None:
            self._recorder = _recorder(settings) if settings.record.directory else None
        elif settings.record.directory:
            self._recorder.change(*_options_and_papers(settings))

    @property
    def counters(self) -> dict[str, int]:
        """What was written, and what was lost."""
        counted = self._recorder.counters if self._recorder is not None else {}
        found = {f"recorder {name}": count for name, count in sorted(counted.items())}
        return found | ({"mcap dropped": self._mcap.dropped} if self._mcap is not None else {})

    @property
    def recording(self) -> bool:
        """Whether a flight is being recorded now."""
        return self._recorder is not None and self._recorder.recording

    def conditions(self) -> tuple[Condition, ...]:
        """Whether a recording that is wanted does not run, and why."""
        recorder = self._recorder
        if recorder is None or not self._wanted or not recorder.stopped:
            return ()
        return (condition(Code.RECORDING_STOPPED, detail=recorder.stopped),)

    def set_date(self, offset_us: int, source: str) -> None:
        """The date is known: folders get their true names, what follows its true times."""
        if self._recorder is not None:
            self._recorder.set_date(offset_us, source)
        if self._mcap is not None:
            self._mcap.begin_anew()

    def by_hand(self, record: bool) -> None:
        """Start (True) or stop (False) on the user's word; safe in a signal handler."""
        self._switch.by_hand(record)

    def samples(self, samples: Iterable[Sample]) -> None:
        """What the drivers gave: frames are kept, heartbeats say whether the vehicle is armed."""
        for sample in samples:
            if isinstance(sample, Heartbeat):
                self._armed = sample.armed
            elif isinstance(sample, Frame) and self._recorder is not None:
                self._recorder.frame(sample)
            if self._mcap is not None:
                self._mcap.sample(sample)

    def processed(self, output: Processed) -> None:
        """A frame with its estimate, whose message came just before."""
        if self._mcap is not None:
            self._mcap.put(output)

    def mavlink(self, arrival_us: int, packet: bytes) -> None:
        """One packet as it was on the wire, of either direction."""
        if self._recorder is not None:
            self._recorder.mavlink(arrival_us, packet)

    def message(self, message: Message) -> None:
        """One published message."""
        if self._recorder is not None and self._recorder.recording:
            self._recorder.message(topic_of(message), encode(message))
        if self._mcap is not None:
            self._mcap.put(message)

    def step(self, time_us: int) -> list[DriverEvent]:
        """Start or stop as the switch says; what happened since the last step.

        A recording that stopped by itself (disk full, limit reached) is taken up again by the recorder.
        """
        recorder = self._recorder
        if recorder is None:
            return []
        wanted = self._switch.step(time_us, self._armed)
        if wanted and not self._wanted:
            self._folder_before = recorder.folder
            recorder.start()
        elif self._wanted and not wanted:
            recorder.stop("by hand" if self._armed else "disarmed")
        self._wanted = wanted
        if self._mcap is not None:
            # Until the recorder has made its new folder it still names the last one.
            begun = recorder.recording and recorder.folder != self._folder_before
            self._mcap.follow(recorder.folder if begun else None)
            recorder.kept_open = self._mcap.open
        return recorder.events()

    def close(self) -> None:
        """End the recording and wait until it is on the disk."""
        if self._mcap is not None:
            self._mcap.close()
        if self._recorder is not None:
            self._recorder.kept_open = None
            self._recorder.close()
