"""Settings of what is published over zenoh: under which name, how, and the preview image."""

from dataclasses import dataclass
from typing import Annotated, Literal

from companion.settings.marks import FilePath, Meaning
from landing.options import Limits


@dataclass(frozen=True, slots=True)
class VehicleSettings:
    """The vehicle's names and its size."""

    name: Annotated[str, Meaning("vehicle name in the zenoh keys landslope/NAME/...")] = "vehicle1"
    system_id: Annotated[int, Limits(0, 255, "", "MAVLink system id; 0: the only vehicle on the link")] = 0
    rangefinder: Annotated[
        bool, Meaning("use the rangefinder that looks down (DISTANCE_SENSOR) for the height, and to check it")
    ] = False
    landing_radius_m: Annotated[
        float, Limits(0.1, 2, "m", "radius of the disc of ground that the vehicle stands on")
    ] = 0.5
    max_step_m: Annotated[
        float, Limits(0.01, 1, "m", "largest step within that disc that the vehicle can stand on")
    ] = 0.05
    max_search_m: Annotated[
        float, Limits(1, 50, "m", "how far from where it began the procedure searches for a place to land")
    ] = 8.0


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """Publishing over zenoh."""

    mode: Annotated[
        Literal["peer", "client"], Meaning('"client" of the router in zenoh.connect, or peer to peer')
    ] = "peer"
    connect: Annotated[tuple[str, ...], Meaning('endpoints to connect to, as "tcp/192.168.1.10:7447"')] = ()
    listen: Annotated[tuple[str, ...], Meaning('endpoints to listen on, as "tcp/0.0.0.0:7447"')] = ()
    scouting: Annotated[bool, Meaning("find other zenoh sessions by multicast")] = False
    config: Annotated[
        str, FilePath("a zenoh configuration file (JSON5) to start from: TLS, access control")
    ] = ""


@dataclass(frozen=True, slots=True)
class PreviewSettings:
    """The preview: a small JPEG image of the camera, published while there is a subscriber."""

    rate_hz: Annotated[float, Limits(0.2, 30, "Hz", "maximum preview rate while there is a subscriber")] = 5.0
    width_px: Annotated[int, Limits(64, 1280, "px", "maximum width; larger images are scaled down")] = 320
    jpeg_quality: Annotated[int, Limits(10, 95, "", "JPEG quality")] = 70
    max_tracks: Annotated[int, Limits(10, 1000, "", "maximum number of tracks in a preview")] = 150
