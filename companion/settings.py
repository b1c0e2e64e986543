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
    time_offset_s: Annotated[float, Limits(-0.5, 0.5, "s", "how late the frames' time stamps are")] = 0.0


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


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """How messages get out."""

    mode: Annotated[Literal["peer", "client"], Meaning("peer to peer, or client of a router")] = "peer"
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


@dataclass(frozen=True, slots=True)
class Settings:
    """All sections."""

    camera: CameraSettings = field(default_factory=CameraSettings)
    vehicle: VehicleSettings = field(default_factory=VehicleSettings)
    mavlink: MavlinkSettings = field(default_factory=MavlinkSettings)
    zenoh: ZenohSettings = field(default_factory=ZenohSettings)
    tracking: TrackingOptions = field(default_factory=TrackingOptions)
    estimator: EstimatorOptions = field(default_factory=EstimatorOptions)
    decision: DecisionOptions = field(default_factory=DecisionOptions)
    landing: LandingSettings = field(default_factory=LandingSettings)
    preview: PreviewSettings = field(default_factory=PreviewSettings)
