"""Every message landslope publishes: its fields, its key, its rate. Field names are a contract: add, never rename."""

import math
from dataclasses import dataclass
from typing import Any

import msgspec

from landing.estimate import SurfaceEstimate


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """The surface below at one frame. Unknown numbers are null."""

    frame: int
    time_unix_us: int
    time_boot_s: float | None
    status: str
    method: str
    ventral_flow_x: float | None
    ventral_flow_y: float | None
    divergence: float | None
    time_to_contact_s: float | None
    slope_x_deg: float | None
    slope_y_deg: float | None
    slope_x_std_deg: float | None
    slope_y_std_deg: float | None
    roll_deg: float | None
    pitch_deg: float | None
    surface_pitch_deg: float | None
    surface_roll_deg: float | None
    inclination_deg: float | None
    inclination_std_deg: float | None
    downhill_bearing_deg: float | None
    roughness: float | None
    roughness_std: float | None
    height_m: float | None
    height_std_m: float | None
    features: int
    inlier_fraction: float | None
    fit_error_px: float | None
    flat: bool
    against_flat: tuple[str, ...]
    calibrated: bool


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """What is made of the estimates: the verdict with hysteresis and dwell, and the permit."""

    frame: int
    time_unix_us: int
    verdict: str
    """"fit", "unfit" or "unknown"."""
    reasons: tuple[str, ...]
    """What stands against landing, in words; empty when the surface is fit."""
    since_unix_us: int
    permitted: bool
    """Whether a request may go out now."""
    withheld: tuple[str, ...]
    """What stands against the permission, in words."""
    requested: bool
    """Whether a landing was requested under the present permission."""
    command: str
    """State of the command: "none", "requested", "accepted", "landing", "landed", or why it failed."""


class InputHealth(msgspec.Struct, frozen=True, kw_only=True):
    """One input: how often it comes and how old the newest is."""

    state: str
    count: int
    refused: int
    rate_hz: float | None
    age_s: float | None


class Health(msgspec.Struct, frozen=True, kw_only=True):
    """The state of every input and what is wrong, once a second."""

    time_unix_us: int
    state: str
    """"ok", "degraded" or "failed"."""
    problems: tuple[str, ...]
    inputs: dict[str, InputHealth]
    counters: dict[str, int]
    clock_offset_s: float | None
    clock_std_s: float | None
    pipeline_ms: float | None


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened, once."""

    event: str
    frame: int | None
    time_unix_us: int
    severity: str
    """"info", "warning" or "error"."""
    text: str
    details: dict[str, Any] = {}


Message = Estimate | Decision | Health | Event


@dataclass(frozen=True, slots=True)
class Topic:
    """One line of the table of messages."""

    name: str
    """Last part of the key ``landslope/<vehicle>/<name>``."""
    type: type | None
    rate: str
    recorded: bool


TOPICS = (
    Topic("estimate", Estimate, "every frame", True),
    Topic("decision", Decision, "on change, and every second", True),
    Topic("health", Health, "1 Hz", True),
    Topic("event", Event, "as they happen", True),
    Topic("preview", None, "5 Hz while somebody subscribes", False),
)


def topic_of(message: Message) -> str:
    """The topic's name for a message."""
    return type(message).__name__.lower()


_encoder = msgspec.json.Encoder(order="deterministic")


def encode(message: Message) -> bytes:
    """The message as one line of JSON (no newline); NaN becomes null."""
    return _encoder.encode(message)


def known(value: float, digits: int) -> float | None:
    """A number for a message: rounded, None where unknown."""
    return round(float(value), digits) if math.isfinite(value) else None


def estimate_message(
    e: SurfaceEstimate, time_unix_us: int, time_boot_s: float | None, calibrated: bool
) -> Estimate:
    """The message for an estimate of the pipeline."""
    return Estimate(
        frame=e.frame,
        time_unix_us=time_unix_us,
        time_boot_s=None if time_boot_s is None else round(time_boot_s, 6),
        status=e.status,
        method=e.method,
        ventral_flow_x=known(e.ventral_flow_x, 6),
        ventral_flow_y=known(e.ventral_flow_y, 6),
        divergence=known(e.divergence, 6),
        time_to_contact_s=known(e.time_to_contact_s, 4),
        slope_x_deg=known(e.slope_x_deg, 4),
        slope_y_deg=known(e.slope_y_deg, 4),
        slope_x_std_deg=known(e.slope_x_std_deg, 4),
        slope_y_std_deg=known(e.slope_y_std_deg, 4),
        roll_deg=known(e.roll_deg, 4),
        pitch_deg=known(e.pitch_deg, 4),
        surface_pitch_deg=known(e.surface_pitch_deg, 4),
        surface_roll_deg=known(e.surface_roll_deg, 4),
        inclination_deg=known(e.inclination_deg, 4),
        inclination_std_deg=known(e.inclination_std_deg, 4),
        downhill_bearing_deg=known(e.downhill_bearing_deg, 3),
        roughness=known(e.roughness, 6),
        roughness_std=known(e.roughness_std, 6),
        height_m=known(e.height_m, 4),
        height_std_m=known(e.height_std_m, 4),
        features=e.features,
        inlier_fraction=known(e.inlier_fraction, 4),
        fit_error_px=known(e.fit_error_px, 4),
        flat=e.flat,
        against_flat=e.against_flat,
        calibrated=calibrated,
    )
