"""Standing conditions: what is wrong and stays wrong until it is gone. One table, the only place of their words.

Everything that shows the state of a vehicle (health, the permission, ground stations, the page, the terminal, the
service manager) shows these, from the moment they begin until they are over.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import msgspec


class Code(StrEnum):
    """Every standing condition there is."""

    INPUT_MISSING = "input_missing"
    INPUT_STALE = "input_stale"
    VITAL_INPUT_MISSING = "vital_input_missing"
    VITAL_INPUT_STALE = "vital_input_stale"
    CLOCKS_UNRELATED = "clocks_unrelated"
    CAMERA_FROZEN = "camera_frozen"
    ROTATION_CONTRADICTS = "rotation_contradicts"
    VELOCITY_CONTRADICTS = "velocity_contradicts"
    LATENESS_CONTRADICTS = "lateness_contradicts"
    HEIGHT_CONTRADICTS = "height_contradicts"
    VELOCITY_UNKNOWN = "velocity_unknown"
    ATTITUDE_UNSURE = "attitude_unsure"
    ATTITUDE_MISSING = "attitude_missing"
    TWO_VEHICLES = "two_vehicles"
    IMAGE_SIZE = "image_size"
    READOUT_UNKNOWN = "readout_unknown"
    UNCALIBRATED = "uncalibrated"
    MASK_LARGE = "mask_large"
    RECORDING_STOPPED = "recording_stopped"
    CLOCK_WITHOUT_DATE = "clock_without_date"
    RADIO_LOST = "radio_lost"
    RATE_TOO_LOW = "rate_too_low"
    OVERLOADED = "overloaded"
    UNSIGNED = "unsigned"


@dataclass(frozen=True, slots=True)
class Kind:
    """How grave a condition is ("warning", "error"), its words, and whether it forbids a landing by itself.

    An input that is needed forbids a landing too: the permission names those as stale.
    """

    severity: str
    text: str
    forbids_landing: bool = False


KINDS = {
    Code.VITAL_INPUT_MISSING: Kind("error", "{subject}: none came"),
    Code.VITAL_INPUT_STALE: Kind("error", "{subject}: none for {detail}"),
    Code.CAMERA_FROZEN: Kind(
        "error", "camera: the picture stands still while the vehicle turns", forbids_landing=True
    ),
    Code.ROTATION_CONTRADICTS: Kind("error", "camera: the picture does not turn as the gyro does"),
    Code.VELOCITY_CONTRADICTS: Kind(
        "error", "camera: the ground does not move as the vehicle's velocity says"
    ),
    Code.LATENESS_CONTRADICTS: Kind("error", "camera: the pictures are too late, or not as late as before"),
    Code.HEIGHT_CONTRADICTS: Kind(
        "error", "height: the rangefinder does not agree with the velocity and the pictures' motion"
    ),
    Code.ATTITUDE_MISSING: Kind("error", "the frames have no attitude: {detail}", forbids_landing=True),
    Code.TWO_VEHICLES: Kind("error", "two vehicles on the link: set vehicle.system_id", forbids_landing=True),
    Code.IMAGE_SIZE: Kind("error", "camera: {detail}", forbids_landing=True),
    Code.UNCALIBRATED: Kind("warning", "the camera is not calibrated", forbids_landing=True),
    Code.READOUT_UNKNOWN: Kind(
        "warning",
        "camera: the rows' readout is not known yet; it is found while the vehicle turns, or set camera.readout_s",
    ),
    Code.VELOCITY_UNKNOWN: Kind(
        "warning",
        "the autopilot does not know its velocity, so nothing is known in metres: check its position source",
    ),
    Code.ATTITUDE_UNSURE: Kind("warning", "the autopilot's estimator is unsure of roll and pitch"),
    Code.INPUT_MISSING: Kind("warning", "{subject}: none came"),
    Code.INPUT_STALE: Kind("warning", "{subject}: none for {detail}"),
    Code.CLOCKS_UNRELATED: Kind("warning", "clocks: the autopilot's time is not known yet"),
    Code.RADIO_LOST: Kind("warning", "radio: the pilot's switch is not heard"),
    Code.UNSIGNED: Kind("warning", "signing: the autopilot signs nothing; give it mavlink.signing_key too"),
    Code.RATE_TOO_LOW: Kind("warning", "{subject}: {detail} asked for"),
    Code.OVERLOADED: Kind(
        "warning",
        "the processor is too slow: {detail}; lower camera.rate_hz, camera.width and height, or tracking.max_features",
    ),
    Code.MASK_LARGE: Kind(
        "warning",
        "camera: {detail} of the picture does not show the ground; move the camera, clean the lens, or see camera.mask",
    ),
    Code.RECORDING_STOPPED: Kind("warning", "not recording: {detail}"),
    Code.CLOCK_WITHOUT_DATE: Kind("warning", "clock: the date is not known"),
}
"""Gravest first: where little room is, the first are shown."""

_ORDER = {code: place for place, code in enumerate(KINDS)}


class Condition(msgspec.Struct, frozen=True, kw_only=True):
    """Something that is wrong now."""

    code: Annotated[str, msgspec.Meta(description="which condition, one word")]
    subject: Annotated[str, msgspec.Meta(description="what it is about, where there are several")] = ""
    severity: Annotated[str, msgspec.Meta(description='"warning" or "error"')]
    text: Annotated[str, msgspec.Meta(description="the condition in words")]
    forbids_landing: Annotated[bool, msgspec.Meta(description="whether it forbids a landing by itself")]


def condition(code: Code, subject: str = "", detail: str = "") -> Condition:
    """A condition of the table; ``detail`` may change while the condition stays the same."""
    kind = KINDS[code]
    return Condition(
        code=code.value,
        subject=subject,
        severity=kind.severity,
        text=kind.text.format(subject=subject.replace("_", " "), detail=detail),
        forbids_landing=kind.forbids_landing,
    )


def gravest_first(conditions: Iterable[Condition]) -> tuple[Condition, ...]:
    """In the order of the table; each once, however many sources reported it."""
    found = {identity(c): c for c in conditions}
    return tuple(sorted(found.values(), key=lambda c: _ORDER[Code(c.code)]))


def identity(c: Condition) -> tuple[str, str]:
    """What makes two conditions the same one, whatever their words say now."""
    return c.code, c.subject


def state_of(conditions: Iterable[Condition]) -> str:
    """Health in one word: "failed" with an error, "degraded" with a warning, "ok" without any."""
    severities = {c.severity for c in conditions}
    return "failed" if "error" in severities else "degraded" if severities else "ok"
