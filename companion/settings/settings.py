"""The settings: one TOML file, one frozen dataclass a section, every number bounded."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from companion.settings.marks import FilePath, Meaning, UserSettings
from companion.settings.publishing import PreviewSettings, VehicleSettings, ZenohSettings
from companion.settings.record_settings import RecordSettings
from landing.options import DecisionOptions, EstimatorOptions, GroundOptions, Limits, TrackingOptions


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The camera, its calibration and how it is mounted."""

    source: Annotated[
        str, Meaning("source of frames: device, URL or file; a replay uses the recorded flight")
    ] = ""
    calibration: Annotated[str, FilePath("the camera's calibration, a ROS camera_info YAML file")] = ""
    mask: Annotated[
        str, FilePath("PNG of the picture's size: black pixels never show the ground, as skids")
    ] = ""
    learn_mask: Annotated[
        bool, Meaning("mask what stands still in the picture while the ground moves, as skids or dirt")
    ] = True
    mount_roll_deg: Annotated[float, Limits(-180, 180, "deg", "camera's roll in the body frame")] = 0.0
    mount_pitch_deg: Annotated[float, Limits(-180, 180, "deg", "camera's pitch in the body frame")] = 0.0
    mount_yaw_deg: Annotated[float, Limits(-180, 180, "deg", "camera's yaw in the body frame")] = 0.0
    assumed_fov_deg: Annotated[
        float, Limits(10, 150, "deg", "field of view across the image assumed without a calibration")
    ] = 60.0
    time_offset_s: Annotated[float, Limits(-0.5, 0.5, "s", "delay of the frames' time stamps")] = 0.0
    readout_s: Annotated[
        float | Literal["unknown"],
        Limits(
            -0.1,
            0.1,
            "s",
            "rolling shutter, first row to last; 0: global shutter, negative: last row first; unknown: estimated",
        ),
    ] = "unknown"
    width: Annotated[int, Limits(0, 4096, "px", "requested image width; 0: the camera's default")] = 0
    height: Annotated[int, Limits(0, 4096, "px", "requested image height; 0: the camera's default")] = 0
    rate_hz: Annotated[float, Limits(0, 240, "Hz", "requested frame rate; 0: the camera's default")] = 0.0
    exposure_us: Annotated[
        int, Limits(0, 100_000, "us", "fixed exposure; 0: automatic, which blurs in poor light")
    ] = 0
    gain: Annotated[
        float, Limits(-1, 10_000, "", "fixed gain in the camera's own units; -1: unchanged")
    ] = -1.0
    pixel_format: Annotated[str, Meaning('V4L2 pixel format, as "GREY", "YUYV" or "MJPG"; empty: any')] = ""
    transport: Annotated[Literal["tcp", "udp"], Meaning("transport of an RTSP stream")] = "tcp"
    open_timeout_s: Annotated[float, Limits(1, 60, "s", "time-out for a camera's first frame")] = 8.0
    read_timeout_s: Annotated[
        float, Limits(0.2, 30, "s", "time without a frame after which the camera is reopened")
    ] = 2.0


@dataclass(frozen=True, slots=True)
class MavlinkSettings:
    """The link to the autopilot."""

    connection: Annotated[str, Meaning('the link, as "udpin:0.0.0.0:14550" or "/dev/ttyAMA0:921600"')] = ""
    component_id: Annotated[int, Limits(1, 255, "", "landslope's MAVLink component id")] = 191
    autopilot_component: Annotated[int, Limits(1, 255, "", "MAVLink component id of the autopilot")] = 1
    attitude_rate_hz: Annotated[float, Limits(1, 400, "Hz", "requested rate of ATTITUDE")] = 100.0
    imu_rate_hz: Annotated[float, Limits(1, 400, "Hz", "requested rate of RAW_IMU or HIGHRES_IMU")] = 100.0
    position_rate_hz: Annotated[float, Limits(1, 100, "Hz", "requested rate of LOCAL_POSITION_NED")] = 30.0
    state_rate_hz: Annotated[
        float, Limits(0.5, 50, "Hz", "requested rate of EXTENDED_SYS_STATE and RC_CHANNELS")
    ] = 5.0
    timesync_rate_hz: Annotated[float, Limits(0.1, 50, "Hz", "rate of TIMESYNC requests")] = 5.0
    forward: Annotated[
        tuple[str, ...], Meaning('endpoints of other programs on the same link, as "udpout:127.0.0.1:14560"')
    ] = ()
    forward_open: Annotated[
        bool,
        Meaning("allow mavlink.forward to addresses off this machine: anybody who reaches them can command"),
    ] = False
    signing_key: Annotated[
        str,
        FilePath(
            "MAVLink 2 signing key: 64 hex digits, or a file with them or 32 bytes; empty: no signing",
            or_key=True,
        ),
    ] = ""
    heartbeat_max_age_s: Annotated[
        float,
        Limits(0.5, 30, "s", "heartbeats stop when no frame was processed for this long"),
    ] = 2.0
    status_text: Annotated[bool, Meaning("send STATUSTEXT when verdict, command or health change")] = True
    named_value_rate_hz: Annotated[
        float, Limits(0, 10, "Hz", "rate of NAMED_VALUE_FLOAT to ground stations; 0: none")
    ] = 2.0
    optical_flow: Annotated[
        bool, Meaning("send OPTICAL_FLOW to the autopilot's estimator at every frame")
    ] = False


@dataclass(frozen=True, slots=True)
class SyncSettings:
    """Time synchronisation of frames and telemetry."""

    attitude_wait_s: Annotated[
        float, Limits(0.02, 2, "s", "longest wait of a frame for an attitude later than its exposure")
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
        float, Limits(0, 0.05, "s", "delay of the gyro by the autopilot's low-pass filter")
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
    """When an input counts as stale, and when a camera counts as frozen."""

    frames_max_age_s: Annotated[
        float, Limits(0.05, 10, "s", "age at which the camera's newest frame is stale")
    ] = 0.5
    attitude_max_age_s: Annotated[
        float, Limits(0.05, 10, "s", "age at which the newest attitude is stale")
    ] = 0.5
    gyro_max_age_s: Annotated[
        float, Limits(0.05, 10, "s", "age at which the newest gyro sample is stale")
    ] = 0.5
    velocity_max_age_s: Annotated[
        float, Limits(0.05, 10, "s", "age at which the newest velocity is stale")
    ] = 1.0
    heartbeat_max_age_s: Annotated[
        float, Limits(1, 30, "s", "age at which the autopilot's last heartbeat is stale")
    ] = 3.0
    landed_state_max_age_s: Annotated[
        float, Limits(0.2, 30, "s", "age at which the landed state is stale")
    ] = 3.0
    period_s: Annotated[float, Limits(0.1, 10, "s", "interval between health messages")] = 1.0
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
class LandingSettings:
    """When a landing may be requested."""

    enabled: Annotated[bool, Meaning("allow landing requests from the start, without a pilot's switch")] = (
        False
    )
    procedure: Annotated[
        Literal["land", "landing_target", "offboard"],
        Meaning(
            "land: request the landing where it is; landing_target: and send where to; offboard: fly there and descend"
        ),
    ] = "land"
    takeover_modes: Annotated[
        tuple[str, ...],
        Meaning("flight modes in which landing.procedure = offboard may take over; empty: in none"),
    ] = ()
    descent_divergence: Annotated[
        float, Limits(0.2, 0.35, "1/s", "sink over height while the procedure descends")
    ] = 0.25
    max_speed_m_s: Annotated[
        float, Limits(0.3, 3, "m/s", "largest speed the procedure asks for, horizontally and vertically")
    ] = 1.5
    max_time_s: Annotated[
        float, Limits(10, 600, "s", "time after which the procedure gives the vehicle back")
    ] = 120.0
    allowed_modes: Annotated[tuple[str, ...], Meaning("flight modes in which a landing may be requested")] = (
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
        int, Limits(0, 18, "", "RC channel of the pilot's switch; 0: none, landing.enabled applies")
    ] = 0
    enable_rc_above_us: Annotated[
        int, Limits(900, 2100, "us", "pulse width above which the pilot's switch is on")
    ] = 1700
    enable_rc_hysteresis_us: Annotated[
        int, Limits(0, 400, "us", "hysteresis: the switch is off below enable_rc_above_us minus this")
    ] = 100
    enable_rc_max_age_s: Annotated[
        float, Limits(0.2, 10, "s", "time without RC_CHANNELS after which the switch counts as off")
    ] = 1.5
    enable_modes: Annotated[
        tuple[str, ...], Meaning("flight modes that act as the pilot's switch; empty: none")
    ] = ()
    vehicle_types: Annotated[
        tuple[str, ...],
        Meaning(
            'vehicles beside multicopters and hovering VTOLs that may be landed, as "FIXED_WING" of MAV_TYPE'
        ),
    ] = ()
    stick_limit_us: Annotated[
        int, Limits(0, 600, "us", "stick movement that ends the permission; 0: never")
    ] = 300
    mode_timeout_s: Annotated[
        float, Limits(1, 30, "s", "time-out for the LAND mode after the command was accepted")
    ] = 5.0
    request_max_age_s: Annotated[
        float, Limits(0.1, 5, "s", "maximum age of a request's frame; an older request is not sent")
    ] = 1.0
    on_unfit: Annotated[
        Literal["report", "hold"], Meaning("action when the surface becomes unfit after the request")
    ] = "report"
    unfit_min_height_m: Annotated[
        float, Limits(0.3, 100, "m", "height below which an unfit surface causes no action")
    ] = 1.5
    unfit_min_contact_s: Annotated[
        float, Limits(0.5, 30, "s", "the same limit as time to contact, used when the height is unknown")
    ] = 3.0


@dataclass(frozen=True, slots=True)
class Settings:
    """All sections."""

    camera: CameraSettings = field(default_factory=CameraSettings)
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    mavlink: MavlinkSettings = field(default_factory=MavlinkSettings)
    sync: Annotated[
        SyncSettings,
        UserSettings(
            "attitude_wait_s",
            "gyro_delay_s",
        ),
    ] = field(default_factory=SyncSettings)
    health: Annotated[
        HealthSettings,
        UserSettings(
            "frames_max_age_s",
            "attitude_max_age_s",
            "gyro_max_age_s",
            "velocity_max_age_s",
            "heartbeat_max_age_s",
            "landed_state_max_age_s",
            "period_s",
        ),
    ] = field(default_factory=HealthSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    tracking: Annotated[
        TrackingOptions,
        UserSettings("max_features"),
    ] = field(default_factory=TrackingOptions)
    estimator: Annotated[
        EstimatorOptions,
        UserSettings(
            "method",
            "seed",
            "time_offset_std_s",
            "use_attitude",
            "attitude_std_deg",
            "min_tracks",
            "max_slope_std_deg",
            "memory_s",
        ),
    ] = field(default_factory=EstimatorOptions)
    decision: Annotated[
        DecisionOptions,
        UserSettings(
            "max_inclination_deg",
            "max_roughness",
            "sigmas",
            "hysteresis",
            "dwell_s",
            "patience_s",
            "max_relief_m",
            "max_patch_m",
            "landing_radius_m",
            "min_area_measured",
            "min_coverage",
            "max_ground_speed_m_s",
            "touchdown_known",
        ),
    ] = field(default_factory=DecisionOptions)
    landing: LandingSettings = field(default_factory=LandingSettings)
    record: RecordSettings = field(default_factory=RecordSettings)
    preview: PreviewSettings = field(default_factory=PreviewSettings)

    @property
    def ground(self) -> GroundOptions:
        """The ground map's options: what the vehicle can stand on, and the decision's limits."""
        return GroundOptions(
            landing_radius_m=self.vehicle.landing_radius_m,
            max_step_m=self.vehicle.max_step_m,
            max_inclination_deg=self.decision.max_inclination_deg,
            sigmas=self.decision.sigmas,
        )
