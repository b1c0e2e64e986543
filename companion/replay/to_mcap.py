"""A recorded flight through the pipeline into an MCAP file."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2

from companion.core.core import Core
from companion.export.mcap_sink import McapSink
from companion.replay.source import PlainCamera, open_source
from drivers.errors import DriverError

SIDE_FILES = ("landslope.toml", "camera.yaml")


@dataclass(frozen=True, slots=True)
class Exported:
    """What went into the file; ``damage`` says why the recording ended early, empty if it did not."""

    frames: int
    estimates: int
    events: int
    damage: str


def export(flight: Path, out: Path, config: Path | None = None, overrides: tuple[str, ...] = ()) -> Exported:
    """Run the flight as ``landslope replay`` does and write every frame, message and event to ``out``."""
    cv2.setNumThreads(1)  # as replay: the same rounding everywhere
    source = open_source(flight, config, overrides, PlainCamera())
    core = Core(source.settings, source.camera, calibrated=source.calibrated, telemetry=source.telemetry)
    beside = {name: (flight / name).read_bytes() for name in SIDE_FILES if (flight / name).is_file()}
    sink = McapSink(out, source.settings.vehicle.name, source.camera, attachments=beside)
    damage = ""
    with ExitStack() as unless_done:
        unless_done.callback(sink.abandon)
        try:
            for sample in source.samples():
                sink.sample(sample)
                for output in core.feed(sample):
                    sink.put(output)
        except DriverError as error:
            if not sink.frames:
                raise
            damage = str(error)
        for output in core.finish():
            sink.put(output)
        unless_done.pop_all()
    sink.close()
    return Exported(sink.frames, sink.estimates, sink.events, damage)
