"""What a look before the flight finds: one line each, with the remedy, and the limits."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal

from drivers.secrets import masked
from landing.options import Limits

Level = Literal["ok", "warning", "failure"]
EXIT_CODES: dict[Level, int] = {"ok": 0, "warning": 1, "failure": 2}


@dataclass(frozen=True, slots=True)
class Finding:
    """One line: what was looked at, how it stands, what was seen, and what to do about it."""

    subject: str
    level: Level
    text: str
    remedy: str = ""

    def line(self, width: int) -> str:
        """As it is printed; ``width`` of the column of subjects."""
        remedy = f"\n{'':{width + 11}}-> {self.remedy}" if self.remedy else ""
        return masked(f"{self.level:<9} {self.subject:<{width}} {self.text}{remedy}")


@dataclass(frozen=True, slots=True)
class DoctorOptions:
    """Bounds of what counts as well."""

    min_frame_rate_hz: Annotated[float, Limits(1, 240, "Hz", "frame rate below which slopes get poor")] = 15.0
    rate_share: Annotated[float, Limits(0.1, 1, "", "share of a rate asked for that must come")] = 0.8
    max_frame_jitter: Annotated[
        float, Limits(0.01, 2, "", "spread of the frame interval, over the interval")
    ] = 0.2
    max_latency_s: Annotated[float, Limits(0.005, 2, "s", "from capture to arrival")] = 0.2
    max_saturated: Annotated[float, Limits(0, 1, "", "share of white or black pixels")] = 0.25
    min_contrast: Annotated[float, Limits(0, 100, "grey", "standard deviation of the picture")] = 6.0
    max_blur: Annotated[float, Limits(0, 1, "", "blur: 0 is sharp, 1 is flat")] = 0.5
    min_corners: Annotated[int, Limits(0, 1000, "", "corners that can be followed")] = 30
    max_link_jitter_s: Annotated[
        float, Limits(0.001, 1, "s", "delay of the slowest twentieth of the messages")
    ] = 0.03
    max_clock_std_s: Annotated[float, Limits(0.0001, 0.1, "s", "doubt about the autopilot's clock")] = 0.01
    max_round_trip_s: Annotated[float, Limits(0.001, 1, "s", "shortest TIMESYNC round trip")] = 0.05


def exit_code(findings: Iterable[Finding]) -> int:
    """0: all well; 1: warnings; 2: failures."""
    return max((EXIT_CODES[finding.level] for finding in findings), default=0)
