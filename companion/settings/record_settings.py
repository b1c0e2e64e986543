"""The [record] section: whether, where and how much is recorded."""

from dataclasses import dataclass
from typing import Annotated, Literal

from companion.settings.marks import FilePath, Meaning
from landing.options import Limits


@dataclass(frozen=True, slots=True)
class RecordSettings:
    """Whether and how flights are recorded, as folders that a replay plays back."""

    directory: Annotated[
        str, FilePath("directory for recorded flights; empty: nothing is recorded", must_exist=False)
    ] = ""
    when: Annotated[
        Literal["armed", "always", "manual"],
        Meaning("record while armed, always, or from SIGUSR1 to SIGUSR2"),
    ] = "armed"
    after_disarm_s: Annotated[float, Limits(0, 600, "s", "time that recording continues after disarming")] = (
        5.0
    )
    jpeg_quality: Annotated[int, Limits(50, 100, "", "JPEG quality of the recorded frames")] = 95
    max_flight_mb: Annotated[int, Limits(1, 1_000_000, "MB", "size at which a new folder is begun")] = 4000
    min_free_mb: Annotated[int, Limits(1, 1_000_000, "MB", "free space below which nothing is recorded")] = (
        500
    )
    max_total_mb: Annotated[
        int, Limits(0, 100_000_000, "MB", "maximum size of all flight folders together; 0: no limit")
    ] = 0
    when_full: Annotated[
        Literal["stop", "delete_oldest"],
        Meaning("at record.max_total_mb or record.min_free_mb: stop recording, or delete the oldest flights"),
    ] = "stop"
    mcap: Annotated[bool, Meaning("also write flight.mcap for Foxglove (needs the extra 'record')")] = False
