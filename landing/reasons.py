"""What speaks against flat ground or a landing, as values; the one place that makes words of them."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

NAN = math.nan


class Status(StrEnum):
    """Of an estimate: ``ok``, or why there is none."""

    OK = "ok"
    STARTING = "starting"
    TOO_FEW_TRACKS = "too_few_tracks"
    MOTION_TOO_SMALL = "motion_too_small"
    SLOPE_UNCERTAIN = "slope_uncertain"
    NO_FIT = "no_fit"
    TOO_LITTLE_TEXTURE = "too_little_texture"
    ROTATION_CONTRADICTS = "rotation_contradicts"
    VELOCITY_CONTRADICTS = "velocity_contradicts"
    LATENESS_CONTRADICTS = "lateness_contradicts"
    HEIGHT_CONTRADICTS = "height_contradicts"
    CAMERA_FROZEN = "camera_frozen"
    IMAGE_SIZE = "image_size"
    BACKWARD_STAMP = "backward_stamp"
    REPEATED_STAMP = "repeated_stamp"


CONTRADICTIONS = frozenset(
    {
        Status.ROTATION_CONTRADICTS,
        Status.VELOCITY_CONTRADICTS,
        Status.LATENESS_CONTRADICTS,
        Status.HEIGHT_CONTRADICTS,
    }
)
"""Statuses that say that pictures and vehicle do not speak of one motion."""

STATUS_MEANING = {
    Status.OK: "there is an estimate",
    Status.STARTING: "there is no earlier frame yet",
    Status.TOO_FEW_TRACKS: "fewer tracks than an estimate needs",
    Status.MOTION_TOO_SMALL: "the camera has not moved enough over the surface to show its slope",
    Status.SLOPE_UNCERTAIN: "the standard deviation of the slope is above its limit",
    Status.NO_FIT: "no plane explains the motion of enough tracks",
    Status.TOO_LITTLE_TEXTURE: "the tracks cover too little of the picture",
    Status.ROTATION_CONTRADICTS: "the rotation that the pictures show is not the gyro's",
    Status.VELOCITY_CONTRADICTS: "the motion over the ground that the pictures show is not the autopilot's velocity",
    Status.LATENESS_CONTRADICTS: "the pictures are later than can be found, or not as late as they were",
    Status.HEIGHT_CONTRADICTS: "the height by velocity and ventral flow is not the rangefinder's",
    Status.CAMERA_FROZEN: "the picture stands still while the vehicle turns",
    Status.IMAGE_SIZE: "the picture has another size than the calibration",
    Status.BACKWARD_STAMP: "the frame's time stamp lies before the last one",
    Status.REPEATED_STAMP: "the frame's time stamp is the last one's",
}


class Certainty(StrEnum):
    """How sure a reason is, and so what it does to a verdict.

    ``certain``: the ground is unfit, and a verdict of fit ends at once. ``probable``: a verdict of fit ends, what
    follows is unknown. ``possible``: nothing becomes fit, but a verdict of fit outlasts it for ``patience_s``.
    """

    CERTAIN = "certain"
    PROBABLE = "probable"
    POSSIBLE = "possible"


class Code(StrEnum):
    """Every reason; ``MEANING`` says what each means, ``words`` puts one with its numbers in a sentence."""

    NOTHING_SEEN = "nothing_seen"
    NO_FRAMES = "no_frames"
    UNCALIBRATED = "uncalibrated"
    NO_ESTIMATE = "no_estimate"
    INCLINATION_UNKNOWN = "inclination_unknown"
    TOO_STEEP = "too_steep"
    INCLINATION_UNCERTAIN = "inclination_uncertain"
    ROUGHNESS_UNKNOWN = "roughness_unknown"
    TOO_ROUGH = "too_rough"
    ROUGHNESS_AT_BORDER = "roughness_at_border"
    ROUGHNESS_UNCERTAIN = "roughness_uncertain"
    OBSTACLE_POINTS = "obstacle_points"
    APPEARANCE_CHANGE = "appearance_change"
    COVERAGE_TOO_LOW = "coverage_too_low"
    RELIEF_UNRESOLVED = "relief_unresolved"
    GROUND_UNRESOLVED = "ground_unresolved"
    GROUND_NOT_SEEN = "ground_not_seen"
    TOUCHDOWN_HAZARD = "touchdown_hazard"
    TOUCHDOWN_UNKNOWN = "touchdown_unknown"
    STOPPING_POINT_UNKNOWN = "stopping_point_unknown"
    GROUND_MAY_MOVE = "ground_may_move"
    GROUND_MOTION_UNKNOWN = "ground_motion_unknown"
    DWELL = "dwell"


MEANING = {
    Code.NOTHING_SEEN: "no estimate has come yet",
    Code.NO_FRAMES: "the camera gives no frames",
    Code.UNCALIBRATED: "without a calibration of the camera no slope is known",
    Code.NO_ESTIMATE: "this frame has no estimate; its status says why",
    Code.INCLINATION_UNKNOWN: "without an attitude the inclination is unknown",
    Code.TOO_STEEP: "the inclination is above its limit",
    Code.INCLINATION_UNCERTAIN: "the upper bound of the inclination is above its limit",
    Code.ROUGHNESS_UNKNOWN: "the roughness is unknown",
    Code.TOO_ROUGH: "the roughness is above its limit",
    Code.ROUGHNESS_AT_BORDER: "ground that has just come into view may have relief",
    Code.ROUGHNESS_UNCERTAIN: "the upper bound of the roughness is above its limit",
    Code.OBSTACLE_POINTS: "single points lie above or below the plane",
    Code.APPEARANCE_CHANGE: "ground that comes into view looks different from the rest and has not been measured",
    Code.COVERAGE_TOO_LOW: "too little of the view is covered by tracks",
    Code.RELIEF_UNRESOLVED: "from this height the relief in metres may be above its limit",
    Code.GROUND_UNRESOLVED: "from this height one track averages over too much ground",
    Code.GROUND_NOT_SEEN: "too little of the landing area is measured",
    Code.TOUCHDOWN_HAZARD: "the ground map has a hazard between straight below and the stopping point",
    Code.TOUCHDOWN_UNKNOWN: "the ground map does not know the ground straight below",
    Code.STOPPING_POINT_UNKNOWN: "the ground map does not know the whole path to the stopping point: fly slower",
    Code.GROUND_MAY_MOVE: "the upper bound of the ground's own speed is above its limit",
    Code.GROUND_MOTION_UNKNOWN: "it is not known yet whether the ground moves by itself",
    Code.DWELL: "the surface has not been flat for long enough",
}


@dataclass(frozen=True, slots=True)
class Reason:
    """One reason: ``value`` is what was found, ``upper`` its upper bound, ``limit`` what is asked for.

    Units are those of the code: degrees, shares of the distance, metres, seconds or a number of points. NaN where
    a code has no such number. ``status`` is the estimate's with NO_ESTIMATE, and the disc's
    codes with TOUCHDOWN_HAZARD, TOUCHDOWN_UNKNOWN and STOPPING_POINT_UNKNOWN.
    """

    code: Code
    certainty: Certainty = Certainty.POSSIBLE
    value: float = NAN
    upper: float = NAN
    limit: float = NAN
    height_m: float = NAN
    status: str = ""

    @property
    def ends_verdict(self) -> bool:
        """Whether a verdict of fit ends with it."""
        return self.certainty is not Certainty.POSSIBLE


_SURE = {Certainty.CERTAIN: "", Certainty.PROBABLE: "probably ", Certainty.POSSIBLE: "perhaps "}

_WORDS = {
    Code.NOTHING_SEEN: "nothing seen yet",
    Code.NO_FRAMES: "no frames",
    Code.UNCALIBRATED: "the camera is not calibrated",
    Code.NO_ESTIMATE: "no estimate: {status}",
    Code.INCLINATION_UNKNOWN: "inclination unknown without an attitude",
    Code.TOO_STEEP: "too steep: {value:.1f} degrees, limit {limit:.1f}",
    Code.INCLINATION_UNCERTAIN: "inclination uncertain: {value:.1f} degrees, may be {upper:.1f}, limit {limit:.1f}",
    Code.ROUGHNESS_UNKNOWN: "roughness unknown",
    Code.TOO_ROUGH: "{sure}too rough: {value:.4f} of the distance, limit {limit:.4f}",
    Code.ROUGHNESS_AT_BORDER: "perhaps too rough: possible relief where ground has just come into view",
    Code.ROUGHNESS_UNCERTAIN: "roughness uncertain: {value:.4f}, may be {upper:.4f}, limit {limit:.4f}",
    Code.OBSTACLE_POINTS: "too rough: {value:.0f} obstacle points, limit {limit:.0f}",
    Code.APPEARANCE_CHANGE: "perhaps another surface: ground that comes into view looks different, not measured yet",
    Code.COVERAGE_TOO_LOW: "too little of the surface seen: {value:.2f}, at least {limit:.2f} needed",
    Code.RELIEF_UNRESOLVED: "too high: relief may be {upper:.3f} m from {height_m:.1f} m, limit {limit:.3f} m",
    Code.GROUND_UNRESOLVED: (
        "too high: a track averages over {value:.2f} m from {height_m:.1f} m, limit {limit:.2f} m"
    ),
    Code.GROUND_NOT_SEEN: (
        "landing area not seen: {value:.2f} of it is measured, at least {limit:.2f} needed"
    ),
    Code.TOUCHDOWN_HAZARD: "hazard where the vehicle would land: {status}",
    Code.TOUCHDOWN_UNKNOWN: "the ground straight below is not known: {status}",
    Code.STOPPING_POINT_UNKNOWN: "the ground where the vehicle would stop is not known, fly slower: {status}",
    Code.GROUND_MAY_MOVE: (
        "{sure}ground that moves by itself: {value:.2f} m/s, may be {upper:.2f}, limit {limit:.2f}"
    ),
    Code.GROUND_MOTION_UNKNOWN: "not known whether the ground moves by itself",
    Code.DWELL: "flat for {value:.1f} s, {limit:.1f} s needed",
}


def words(reason: Reason) -> str:
    """The reason as a clause of plain English with its numbers."""
    return _WORDS[reason.code].format(
        sure=_SURE[reason.certainty],
        value=reason.value,
        upper=reason.upper,
        limit=reason.limit,
        height_m=reason.height_m,
        status=reason.status.replace("_", " "),
    )


def in_words(reasons: Iterable[Reason]) -> tuple[str, ...]:
    """Each reason in words."""
    return tuple(words(reason) for reason in reasons)


def codes(reasons: Iterable[Reason]) -> tuple[str, ...]:
    """Each reason's code."""
    return tuple(str(reason.code) for reason in reasons)
