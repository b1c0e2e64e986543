"""The settings: one TOML file, one frozen dataclass a section, every number bounded."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from landing.options import DecisionOptions, EstimatorOptions, Limits, TrackingOptions


@dataclass(frozen=True, slots=True)
class Meaning:
    """What a setting without limits (text, switch, choice) is for; stands in ``Annotated``."""

    meaning: str


@dataclass(frozen=True, slots=True)
class FilePath:
    """A path; in a settings file relative to that file, in ``--set`` to the working directory."""

    meaning: str = ""
    must_exist: bool = True


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The camera, its calibration and how it is mounted."""

    source: Annotated[str, Meaning("where frames come from; a replay takes the flight's own")] = ""
    calibration: Annotated[str, FilePath("the camera's calibration, a ROS camera_info YAML file")] = ""
    mount_roll_deg: Annotated[float, Limits(-180, 180, "deg", "camera's roll in the body frame")] = 0.0
    mount_pitch_deg: Annotated[float, Limits(-180, 180, "deg", "camera's pitch in the body frame")] = 0.0
    mount_yaw_deg: Annotated[float, Limits(-180, 180, "deg", "camera's yaw in the body frame")] = 0.0
    assumed_fov_deg: Annotated[
        float, Limits(10, 150, "deg", "field of view across the image assumed without a calibration")
    ] = 60.0
    time_offset_s: Annotated[float, Limits(-0.5, 0.5, "s", "how late the frames' time stamps are")] = 0.0
    width: Annotated[int, Limits(0, 4096, "px", "width asked of the camera; 0 takes its own")] = 0
    height: Annotated[int, Limits(0, 4096, "px", "height asked of the camera; 0 takes its own")] = 0
    rate_hz: Annotated[float, Limits(0, 240, "Hz", "rate asked of the camera; 0 takes its own")] = 0.0
    exposure_us: Annotated[
        int, Limits(0, 100_000, "us", "fixed exposure; 0 leaves it automatic, which blurs")
    ] = 0
    gain: Annotated[
        float, Limits(-1, 10_000, "", "fixed gain in the camera's own units; -1 leaves it")
    ] = -1.0
    pixel_format: Annotated[str, Meaning('V4L2 pixel format, as "GREY", "YUYV" or "MJPG"; empty: any')] = ""
    transport: Annotated[Literal["tcp", "udp"], Meaning("how an RTSP stream comes")] = "tcp"
    open_timeout_s: Annotated[float, Limits(1, 60, "s", "patience until a camera's first frame")] = 8.0
    read_timeout_s: Annotated[float, Limits(0.2, 30, "s", "silence after which a camera is opened again")] = (
        2.0
    )


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """Which vehicle."""

    name: Annotated[str, Meaning("the vehicle's part of the keys landslope/NAME/...")] = "vehicle1"
    system_id: Annotated[int, Limits(0, 255, "", "MAVLink system id; 0 takes the only one there is")] = 0


@dataclass(frozen=True, slots=True)
class MavlinkSettings:
    """The link to the autopilot."""

    connection: Annotated[str, Meaning('the link, as "udpin:0.0.0.0:14550" or "/dev/ttyAMA0:921600"')] = ""
    component_id: Annotated[int, Limits(1, 255, "", "our component id")] = 191
    autopilot_component: Annotated[int, Limits(1, 255, "", "the autopilot's component id")] = 1
    attitude_rate_hz: Annotated[float, Limits(1, 400, "Hz", "rate of ATTITUDE asked for")] = 100.0
    imu_rate_hz: Annotated[float, Limits(1, 400, "Hz", "rate of RAW_IMU or HIGHRES_IMU asked for")] = 100.0
    position_rate_hz: Annotated[float, Limits(1, 100, "Hz", "rate of LOCAL_POSITION_NED asked for")] = 30.0
    state_rate_hz: Annotated[
        float, Limits(0.5, 50, "Hz", "rate of EXTENDED_SYS_STATE and RC_CHANNELS asked for")
    ] = 5.0
    timesync_rate_hz: Annotated[float, Limits(0.1, 50, "Hz", "rate of our TIMESYNC requests")] = 5.0
    forward: Annotated[
        tuple[str, ...], Meaning('programs that share the vehicle, as "udpout:127.0.0.1:14560"')
    ] = ()
    signing_key: Annotated[
        str, FilePath("MAVLink 2 signing key (32 bytes or 64 hex digits); empty: nothing is signed")
    ] = ""
    heartbeat_max_age_s: Annotated[
        float,
        Limits(0.5, 30, "s", "our heartbeats stop when the pipeline has made no estimate for this long"),
    ] = 2.0
    status_text: Annotated[bool, Meaning("STATUSTEXT on changes of verdict, command and health")] = True
    named_value_rate_hz: Annotated[
        float, Limits(0, 10, "Hz", "rate of NAMED_VALUE_FLOAT to ground stations; 0: none")
    ] = 2.0
    optical_flow: Annotated[bool, Meaning("OPTICAL_FLOW to the autopilot's estimator, at every frame")] = (
        False
    )


@dataclass(frozen=True, slots=True)
class SyncSettings:
    """How frames and telemetry are brought together in time."""

    attitude_wait_s: Annotated[
        float, Limits(0.02, 2, "s", "how long a frame waits for the attitude behind its exposure")
    ] = 0.25
    attitude_max_gap_s: Annotated[
        float, Limits(0.01, 1, "s", "longest gap between attitudes that is interpolated over")
    ] = 0.25
    slerp_max_gap_s: Annotated[
        float, Limits(0, 1, "s", "gaps between attitudes longer than this are filled with the gyro")
    ] = 0.025
    gyro_max_gap_s: Annotated[
        float, Limits(0.002, 0.5, "s", "longest gap between gyro samples that are integrated")
    ] = 0.05
    gyro_delay_s: Annotated[
        float, Limits(0, 0.05, "s", "how far the autopilot's low-pass filter delays the gyro")
    ] = 0.004
    attitude_noise_rad: Annotated[
        float, Limits(1e-5, 0.02, "rad", "noise of the rotation between two attitudes, one sigma")
    ] = 2e-4
    attitude_delay_std_s: Annotated[
        float, Limits(0, 0.1, "s", "error of the moment that an attitude is true of, one sigma")
    ] = 0.005
    stamp_jitter_s: Annotated[float, Limits(0, 0.02, "s", "jitter of the frames' stamps, one sigma")] = 1e-4
    velocity_max_age_s: Annotated[
        float, Limits(0.02, 2, "s", "oldest velocity that is used for an exposure")
    ] = 0.25
    velocity_delay_s: Annotated[
        float,
        Limits(0, 0.05, "s", "how old a velocity is when it is stamped: half a loop of the autopilot's"),
    ] = 0.001
    velocity_span_s: Annotated[
        float, Limits(0, 1, "s", "how far back velocities are carried on by the accelerometer; 0: not at all")
    ] = 0.2
    accelerometer_delay_s: Annotated[
        float, Limits(0, 0.05, "s", "delay of the accelerometer by the autopilot's filter, until it is found")
    ] = 0.01
    clock_window_s: Annotated[
        float, Limits(10, 3600, "s", "window of the lower envelope of arrival times")
    ] = 300.0
    clock_min_messages: Annotated[
        int, Limits(3, 1000, "", "arrivals before the relation of the clocks is used")
    ] = 10
    drift_max_ppm: Annotated[float, Limits(1, 1000, "ppm", "largest drift between the two crystals")] = 200.0
    jump_min_s: Annotated[float, Limits(0.03, 5, "s", "smallest jump of a clock that is called one")] = 0.1
    jump_confirm_s: Annotated[
        float, Limits(0.1, 5, "s", "how long arrivals must agree on a jump of the companion's clock")
    ] = 0.5
    link_jitter_s: Annotated[float, Limits(0, 0.1, "s", "jitter of the link to the autopilot")] = 0.008
    link_delay_std_s: Annotated[
        float, Limits(0, 0.1, "s", "doubt about the least delay of the link, one sigma")
    ] = 5e-4
    timesync_window_s: Annotated[
        float, Limits(1, 120, "s", "window of which the shortest TIMESYNC round trip is taken")
    ] = 30.0
    timesync_std_floor_s: Annotated[
        float, Limits(1e-5, 0.01, "s", "least doubt about a TIMESYNC round trip, one sigma")
    ] = 2e-4


@dataclass(frozen=True, slots=True)
class HealthSettings:
    """When an input counts as stale."""

    frames_max_age_s: Annotated[float, Limits(0.05, 10, "s", "oldest frame of a live camera")] = 0.5
    attitude_max_age_s: Annotated[float, Limits(0.05, 10, "s", "oldest attitude of a live link")] = 0.5
    gyro_max_age_s: Annotated[float, Limits(0.05, 10, "s", "oldest gyro sample of a live link")] = 0.5
    velocity_max_age_s: Annotated[float, Limits(0.05, 10, "s", "oldest velocity of a live link")] = 1.0
    heartbeat_max_age_s: Annotated[float, Limits(1, 30, "s", "oldest heartbeat of a live autopilot")] = 3.0
    landed_state_max_age_s: Annotated[float, Limits(0.2, 30, "s", "oldest landed state believed")] = 3.0
    period_s: Annotated[float, Limits(0.1, 10, "s", "how often health is told")] = 1.0
    frozen_window_s: Annotated[
        float, Limits(0.1, 5, "s", "span over which the picture must move as the vehicle turns")
    ] = 1.0
    frozen_turn_px: Annotated[
        float, Limits(1, 100, "px", "motion by rotation from which a picture that stands still is noticed")
    ] = 4.0
    frozen_share: Annotated[
        float, Limits(0.01, 0.9, "", "share of the change by that rotation which counts as standing still")
    ] = 0.25
    frozen_witnesses: Annotated[
        int, Limits(1, 100, "", "such pictures in a row that make a camera frozen")
    ] = 5


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """How messages get out."""

    mode: Annotated[
        Literal["peer", "client"], Meaning('"client" of the router that zenoh.connect names, or peer to peer')
    ] = "peer"
    connect: Annotated[tuple[str, ...], Meaning('endpoints to connect to, as "tcp/192.168.1.10:7447"')] = ()
    listen: Annotated[tuple[str, ...], Meaning('endpoints to listen on, as "tcp/0.0.0.0:7447"')] = ()
    scouting: Annotated[bool, Meaning("find others by multicast")] = False
    config: Annotated[
        str, FilePath("a zenoh configuration file (JSON5) to start from: TLS, access control")
    ] = ""


@dataclass(frozen=True, slots=True)
class PreviewSettings:
    """The small picture for whoever watches."""

    rate_hz: Annotated[float, Limits(0.2, 30, "Hz", "most pictures a second while somebody subscribes")] = 5.0
    width_px: Annotated[int, Limits(64, 1280, "px", "width that larger pictures are scaled down to")] = 320
    jpeg_quality: Annotated[int, Limits(10, 95, "", "JPEG quality")] = 70
    max_tracks: Annotated[int, Limits(10, 1000, "", "most tracks drawn on a picture")] = 150


@dataclass(frozen=True, slots=True)
class LandingSettings:
    """Whether a landing may be requested."""

    enabled: Annotated[bool, Meaning("whether landings may be requested from the start")] = False
    allowed_modes: Annotated[tuple[str, ...], Meaning("flight modes that a landing may be requested in")] = (
        "GUIDED",
        "AUTO",
        "LOITER",
        "POSHOLD",
        "OFFBOARD",
        "HOLD",
        "MISSION",
        "POSCTL",
    )
    enable_rc_channel: Annotated[
        int, Limits(0, 18, "", "radio channel of the pilot's switch; 0: none, landing.enabled decides")
    ] = 0
    enable_rc_above_us: Annotated[
        int, Limits(900, 2100, "us", "pulse above which the pilot's switch is on")
    ] = 1700
    enable_rc_hysteresis_us: Annotated[
        int, Limits(0, 400, "us", "how far below that the switch must fall to be off")
    ] = 100
    enable_rc_max_age_s: Annotated[
        float, Limits(0.2, 10, "s", "a radio not heard for this long counts as switched off")
    ] = 1.5
    enable_modes: Annotated[
        tuple[str, ...], Meaning("flight modes that enable landing as the pilot's switch; empty: none")
    ] = ()
    stick_limit_us: Annotated[
        int, Limits(0, 600, "us", "roll, pitch, throttle or yaw moved by this ends the permission; 0: never")
    ] = 300
    mode_timeout_s: Annotated[
        float, Limits(1, 30, "s", "how long an accepted command may take to change the mode to LAND")
    ] = 5.0
    request_max_age_s: Annotated[
        float, Limits(0.1, 5, "s", "a request whose frame is older than this is not sent: something hung")
    ] = 1.0
    on_unfit: Annotated[
        Literal["report", "hold"], Meaning("what to do when the surface turns out unfit after the request")
    ] = "report"
    unfit_min_height_m: Annotated[
        float, Limits(0.3, 100, "m", "below this height an unfit surface no longer matters: it is too late")
    ] = 1.5
    unfit_min_contact_s: Annotated[
        float, Limits(0.5, 30, "s", "the same as time to contact, where the height is not known")
    ] = 3.0


@dataclass(frozen=True, slots=True)
class RecordSettings:
    """Whether and how flights are recorded, as folders that a replay plays back."""

    directory: Annotated[
        str, FilePath("where flight folders are written; empty: nowhere", must_exist=False)
    ] = ""
    when: Annotated[
        Literal["armed", "always", "manual"],
        Meaning("from arming to disarming, always, or on SIGUSR1 (start) and SIGUSR2 (stop) alone"),
    ] = "armed"
    after_disarm_s: Annotated[float, Limits(0, 600, "s", "how long recording goes on after disarming")] = 5.0
    jpeg_quality: Annotated[int, Limits(50, 100, "", "quality of the recorded frames")] = 95
    max_flight_mb: Annotated[int, Limits(1, 1_000_000, "MB", "size at which a recording is ended")] = 4000
    min_free_mb: Annotated[int, Limits(1, 1_000_000, "MB", "free space below which nothing is recorded")] = (
        500
    )
    mcap: Annotated[bool, Meaning("write flight.mcap too, for Foxglove (needs the extra 'record')")] = False


@dataclass(frozen=True, slots=True)
class Settings:
    """All sections."""

    camera: CameraSettings = field(default_factory=CameraSettings)
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    mavlink: MavlinkSettings = field(default_factory=MavlinkSettings)
    sync: SyncSettings = field(default_factory=SyncSettings)
    health: HealthSettings = field(default_factory=HealthSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)
    decision: DecisionOptions = field(default_factory=DecisionOptions)
    landing: LandingSettings = field(default_factory=LandingSettings)
    record: RecordSettings = field(default_factory=RecordSettings)
    preview: PreviewSettings = field(default_factory=PreviewSettings)
