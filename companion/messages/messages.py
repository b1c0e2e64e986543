"""Every message: fields with meaning and unit, key, rate. Field names are a contract: add, never rename."""

from dataclasses import dataclass
from typing import Annotated, Any

import msgspec

from companion.messages.conditions import Condition
from companion.messages.fields import about, known
from companion.messages.ground import Ground
from landing.decision.orders import OrderKind, State, Why
from landing.decision.withheld import Withheld
from landing.estimate import SurfaceEstimate
from landing.reasons import Code, Status, codes, in_words


class Estimate(msgspec.Struct, frozen=True, kw_only=True):
    """The surface below at one frame. Unknown numbers are null."""

    frame: Annotated[int, about("number of the camera frame")]
    time_unix_us: Annotated[int, about("middle of the exposure, companion clock since 1970", "us")]
    time_boot_s: Annotated[float | None, about("the same instant in the autopilot's time since boot", "s")]
    status: Annotated[str, about('"ok", or why there is no estimate', one_of=Status)]
    method: Annotated[str, about('the estimator: "map" or "quadratic"')]
    ventral_flow_x: Annotated[float | None, about("velocity along the image's x over the distance", "1/s")]
    ventral_flow_y: Annotated[float | None, about("velocity along the image's y over the distance", "1/s")]
    divergence: Annotated[
        float | None, about("divergence of the flow; positive when the surface comes nearer", "1/s")
    ]
    time_to_contact_s: Annotated[float | None, about("2 / divergence", "s")]
    slope_x_deg: Annotated[float | None, about("slope along the camera's x", "deg")]
    slope_y_deg: Annotated[float | None, about("slope along the camera's y", "deg")]
    slope_x_std_deg: Annotated[float | None, about("standard deviation of slope_x_deg", "deg")]
    slope_y_std_deg: Annotated[float | None, about("standard deviation of slope_y_deg", "deg")]
    roll_deg: Annotated[float | None, about("the vehicle's roll at the exposure", "deg")]
    pitch_deg: Annotated[float | None, about("the vehicle's pitch at the exposure", "deg")]
    surface_pitch_deg: Annotated[
        float | None, about("slope along the vehicle's x, its pitch subtracted", "deg")
    ]
    surface_roll_deg: Annotated[
        float | None, about("slope along the vehicle's y, its roll subtracted", "deg")
    ]
    inclination_deg: Annotated[
        float | None, about("angle between the surface's normal and the vertical", "deg")
    ]
    inclination_std_deg: Annotated[float | None, about("standard deviation of inclination_deg", "deg")]
    downhill_bearing_deg: Annotated[
        float | None, about("where the surface falls to, clockwise from north", "deg")
    ]
    roughness: Annotated[float | None, about("RMS relief of the surface over its distance")]
    roughness_std: Annotated[float | None, about("standard deviation of roughness")]
    height_m: Annotated[float | None, about("distance to the surface along the camera's axis", "m")]
    height_std_m: Annotated[float | None, about("standard deviation of height_m", "m")]
    features: Annotated[int, about("tracks used")]
    inlier_fraction: Annotated[float | None, about("share of the tracks that move as the plane says")]
    fit_error_px: Annotated[
        float | None, about("mean distance of the tracks from where the fit has them", "px")
    ]
    flat: Annotated[bool, about("this frame's surface is flat and level enough")]
    against_flat: Annotated[tuple[str, ...], about("what speaks against flat, in words")]
    calibrated: Annotated[bool, about("whether the camera is calibrated")]
    against_flat_codes: Annotated[tuple[str, ...], about("the same as codes", one_of=Code)] = ()
    height_source: Annotated[
        str | None, about('what height_m is from: "velocity", "rangefinder" or "both"; null while unknown')
    ] = None


class ProcedureState(msgspec.Struct, frozen=True, kw_only=True):
    """The landing procedure, where ``landing.procedure`` is not "land"."""

    kind: Annotated[str, about('"landing_target" or "offboard"')]
    state: Annotated[str, about("its state", one_of=State)]
    code: Annotated[str, about("why it is in that state", one_of=Why)]
    text: Annotated[str, about("the same in words")]
    order: Annotated[str, about("what is asked of the autopilot", one_of=OrderKind)]
    velocity_ned: Annotated[
        tuple[float, float, float] | None, about("the velocity asked for, north, east, down", "m/s")
    ] = None
    spot_north_m: Annotated[float | None, about("the chosen place, from the vehicle", "m")] = None
    spot_east_m: Annotated[float | None, about("the chosen place, from the vehicle", "m")] = None
    spot_ahead_m: Annotated[float | None, about("the chosen place, ahead of the vehicle, level", "m")] = None
    spot_right_m: Annotated[float | None, about("the chosen place, to the vehicle's right, level", "m")] = (
        None
    )


class Decision(msgspec.Struct, frozen=True, kw_only=True):
    """What is made of the estimates: the verdict with hysteresis and dwell, and the permit."""

    frame: Annotated[int, about("number of the camera frame decided at")]
    time_unix_us: Annotated[int, about("middle of that frame's exposure, companion clock since 1970", "us")]
    verdict: Annotated[str, about('"fit", "unfit" or "unknown"')]
    reasons: Annotated[
        tuple[str, ...], about("what stands against landing, in words; empty when the surface is fit")
    ]
    since_unix_us: Annotated[int, about("since when the verdict stands", "us")]
    permitted: Annotated[bool, about("whether a request may go out now")]
    withheld: Annotated[tuple[str, ...], about("what stands against the permission, in words")]
    requested: Annotated[bool, about("whether a landing was requested under the present permission")]
    command: Annotated[str, about('"none", "requested", "accepted", "landing", "landed", or why it failed')]
    reason_codes: Annotated[tuple[str, ...], about("the reasons as codes", one_of=Code)] = ()
    withheld_codes: Annotated[
        tuple[str, ...], about("the same as ``withheld`` as codes, in the same order", one_of=Withheld)
    ] = ()
    command_code: Annotated[
        str, about('the command as a code: "none", "landing", "held", "failsafe", "taken_over" and so on')
    ] = "none"
    procedure: Annotated[
        ProcedureState | msgspec.UnsetType,
        about('the landing procedure; absent with landing.procedure = "land"'),
    ] = msgspec.UNSET


class InputHealth(msgspec.Struct, frozen=True, kw_only=True):
    """One input: how often it comes and how old the newest is."""

    state: Annotated[str, about('"ok", or what is wrong with this input')]
    count: Annotated[int, about("samples taken since the start")]
    refused: Annotated[int, about("samples refused since the start")]
    rate_hz: Annotated[float | None, about("rate over the last seconds", "Hz")]
    age_s: Annotated[float | None, about("age of the newest sample", "s")]


class Health(msgspec.Struct, frozen=True, kw_only=True):
    """The state of every input and what is wrong, once a second."""

    time_unix_us: Annotated[int, about("when, companion clock since 1970", "us")]
    state: Annotated[str, about('"ok", "degraded" or "failed"')]
    problems: Annotated[tuple[str, ...], about("what is wrong, in words")]
    mode: Annotated[str | None, about("the autopilot's flight mode by name; null while it is not heard")] = (
        None
    )
    armed: Annotated[bool | None, about("whether the vehicle is armed; null while it is not heard")] = None
    recording: Annotated[bool | None, about("whether the flight is recorded; null where none is set up")] = (
        None
    )
    inputs: Annotated[dict[str, InputHealth], about("every input by name")]
    counters: Annotated[
        dict[str, int],
        about(
            "everything counted, by name; refused inputs as `refused INPUT: CODE`, codes in the table below"
        ),
    ]
    clock_offset_s: Annotated[float | None, about("companion clock minus autopilot clock", "s")]
    clock_std_s: Annotated[float | None, about("standard deviation of clock_offset_s", "s")]
    camera_late_s: Annotated[
        float | None, about("lateness of the frames beyond camera.time_offset_s, found and allowed for", "s")
    ]
    camera_late_std_s: Annotated[
        float | None, about("standard deviation of camera_late_s; null: at least so much", "s")
    ]
    pipeline_ms: Annotated[float | None, about("time one frame takes in the pipeline", "ms")]
    conditions: Annotated[
        tuple[Condition, ...], about("what is wrong now, by code; problems are their texts")
    ] = ()
    camera_readout_s: Annotated[
        float | None,
        about("rolling shutter readout, estimated in flight; null until settled, or if set", "s"),
    ] = None
    camera_readout_std_s: Annotated[float | None, about("standard deviation of camera_readout_s", "s")] = None
    camera_masked: Annotated[
        float | None, about("share of the picture that is masked: camera.mask and what stands still in it")
    ] = None
    date_source: Annotated[
        str | None,
        about(
            'what the date is from: "network", "hardware", "system", "set", "autopilot"; null while it is not known'
        ),
    ] = None
    date_offset_s: Annotated[
        float | None,
        about(
            "added to the companion clock's times to make them true; null while the date is not known", "s"
        ),
    ] = None


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """Something that happened, once."""

    event: Annotated[str, about("what happened, one word")]
    frame: Annotated[int | None, about("number of the camera frame, where there is one")]
    time_unix_us: Annotated[int, about("when, companion clock since 1970", "us")]
    severity: Annotated[str, about('"info", "warning" or "error"')]
    text: Annotated[str, about("what happened, in words")]
    details: Annotated[dict[str, Any], about("more, by name")] = {}


Message = Estimate | Ground | Decision | Health | Event


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
    Topic("ground", Ground, "2 Hz, its map 0.5 Hz", True),
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
        height_source=e.height_source or None,
        features=e.features,
        inlier_fraction=known(e.inlier_fraction, 4),
        fit_error_px=known(e.fit_error_px, 4),
        flat=e.flat,
        against_flat=in_words(e.against_flat),
        calibrated=calibrated,
        against_flat_codes=codes(e.against_flat),
    )
