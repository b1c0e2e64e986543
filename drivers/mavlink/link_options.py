"""How a link is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """How a link is used. ``rates_hz``: message name -> rate; "IMU" stands for the gyro message of the autopilot.

    Messages of one autopilot alone (``ONLY_OF``) are asked of that one.
    """

    connection: str
    system_id: int = 0
    autopilot_component: int = 1
    own_component: int = 191
    rates_hz: Mapping[str, float] = field(default_factory=dict)
    forward: Sequence[str] = ()
    signing_key: bytes | None = None
    signing_memory: Path | None = None
    timesync_interval_s: float = 0.2
