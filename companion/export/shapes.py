"""Converts landslope's messages to Foxglove's schemas: transforms, pose, surface, ground map, annotations, log.

Times are microseconds since 1970 of the companion's clock, lengths metres. Frames are named ``<vehicle>/<frame>``:
ned (x north, y east, z down), level (heading only), body (forward, right, down), camera; enu above them has z up.
"""

import math

import msgspec
import numpy as np
from foxglove import messages as fox
from numpy.typing import NDArray

from companion.messages.ground import Ground
from companion.messages.ground_cells import NO_HEIGHT, cells_of
from companion.messages.messages import Estimate, Event
from companion.messages.preview import Preview
from companion.messages.tilt import tilt_of
from landing.ground.ground import CellState
from landing.rotations import log_so3, matrix_from_euler
from landing.vision.camera import CameraModel

INLIER = fox.Color(r=0.0, g=0.9, b=0.35, a=1.0)
OUTLIER = fox.Color(r=1.0, g=0.23, b=0.23, a=1.0)
SURFACE_COLOURS = {
    "fit": fox.Color(r=0.0, g=0.6, b=0.25, a=0.6),
    "unfit": fox.Color(r=0.8, g=0.0, b=0.1, a=0.6),
    "unknown": fox.Color(r=0.4, g=0.4, b=0.4, a=0.6),
}
LEVELS = {"info": fox.LogLevel.Info, "warning": fox.LogLevel.Warning, "error": fox.LogLevel.Error}
MAP_COLOURS = {
    CellState.UNKNOWN: (0, 0, 0, 0),
    CellState.MEASURED: (60, 120, 220, 255),
    CellState.LANDABLE: (50, 170, 70, 255),
    CellState.DISPUTED: (210, 40, 40, 255),
}
"""Red, green, blue, alpha."""
CELL = np.dtype(
    [("elevation", "<f4"), ("state", "u1"), ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("alpha", "u1")]
)
ENU_FROM_NED = fox.Quaternion(x=math.sqrt(0.5), y=math.sqrt(0.5), z=0.0, w=0.0)
MICROSECONDS = 1_000_000
UNKNOWN_HEIGHT_M = 1.0
"""Where the height is unknown the plane is drawn at this distance: its tilt is right, its size is not."""
SURFACE_ID, DISCS_ID = "surface", "landing"
DISC_RADIUS_M, DISC_HEIGHT_M = 0.5, 0.02
DISC_COLOURS = {
    "landable": fox.Color(r=0.1, g=0.75, b=0.3, a=0.6),
    "touchdown landable": fox.Color(r=1.0, g=0.85, b=0.1, a=0.8),
    "touchdown hazard": fox.Color(r=0.9, g=0.1, b=0.1, a=0.8),
    "unknown": fox.Color(r=0.6, g=0.6, b=0.6, a=0.8),
}
# Both windings, so that the plane is seen from below too.
QUAD = [0, 1, 2, 0, 2, 3, 0, 2, 1, 0, 3, 2]


def stamp(time_unix_us: int) -> fox.Timestamp:
    """From microseconds since 1970."""
    return fox.Timestamp(sec=time_unix_us // MICROSECONDS, nsec=time_unix_us % MICROSECONDS * 1000)


def xyzw(rotation: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """The unit quaternion of a rotation matrix (3, 3), scalar last."""
    turn = log_so3(rotation)
    angle = float(np.linalg.norm(turn))
    x, y, z = turn * (math.sin(angle / 2) / angle if angle > 0 else 0.5)
    return float(x), float(y), float(z), math.cos(angle / 2)


def quaternion(rotation: NDArray[np.float64]) -> fox.Quaternion:
    """Of a rotation matrix (3, 3)."""
    x, y, z, w = xyzw(rotation)
    return fox.Quaternion(x=x, y=y, z=z, w=w)


def vector(position: tuple[float, float, float]) -> fox.Vector3:
    """Three numbers."""
    return fox.Vector3(x=position[0], y=position[1], z=position[2])


def transforms(
    time_unix_us: int,
    vehicle: str,
    position_ned: tuple[float, float, float],
    attitude: tuple[float, float, float],
    camera: CameraModel | None,
) -> fox.FrameTransforms:
    """The tree of frames: enu > ned > level, and ned > body > camera (left out without a camera).

    ``position_ned`` in m, ``attitude`` roll, pitch, yaw in radians.
    """
    roll, pitch, yaw = attitude
    at, when = vector(position_ned), stamp(time_unix_us)

    def edge(parent: str, child: str, turn: fox.Quaternion, place: fox.Vector3 | None) -> fox.FrameTransform:
        return fox.FrameTransform(
            timestamp=when,
            parent_frame_id=parent,
            child_frame_id=f"{vehicle}/{child}",
            translation=place or fox.Vector3(x=0.0, y=0.0, z=0.0),
            rotation=turn,
        )

    edges = [
        edge("enu", "ned", ENU_FROM_NED, None),
        edge(f"{vehicle}/ned", "level", quaternion(matrix_from_euler(0.0, 0.0, yaw)), at),
        edge(f"{vehicle}/ned", "body", quaternion(matrix_from_euler(roll, pitch, yaw)), at),
    ]
    if camera is not None:
        edges.append(edge(f"{vehicle}/body", "camera", quaternion(camera.body_from_camera), None))
    return fox.FrameTransforms(transforms=edges)


def pose(
    time_unix_us: int,
    vehicle: str,
    position_ned: tuple[float, float, float],
    attitude: tuple[float, float, float],
) -> fox.PoseInFrame:
    """The vehicle's position (m) and attitude (roll, pitch, yaw in radians), NED."""
    return fox.PoseInFrame(
        timestamp=stamp(time_unix_us),
        frame_id=f"{vehicle}/ned",
        pose=fox.Pose(position=vector(position_ned), orientation=quaternion(matrix_from_euler(*attitude))),
    )


def surface(estimate: Estimate, vehicle: str, verdict: str) -> fox.SceneUpdate:
    """The measured plane as a square of twice its distance a side, coloured by the verdict; deleted while unknown."""
    tilt, when = tilt_of(estimate), stamp(estimate.time_unix_us)
    if tilt is None:
        gone = fox.SceneEntityDeletion(
            timestamp=when, type=fox.SceneEntityDeletionType.MatchingId, id=f"{vehicle}/{SURFACE_ID}"
        )
        return fox.SceneUpdate(deletions=[gone])
    height = UNKNOWN_HEIGHT_M if estimate.height_m is None else estimate.height_m
    corners = [
        fox.Point3(x=height * x, y=height * y, z=height * (1 + tilt.ahead * x + tilt.right * y))
        for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    plane = fox.TriangleListPrimitive(
        points=corners, indices=QUAD, color=SURFACE_COLOURS.get(verdict, SURFACE_COLOURS["unknown"])
    )
    entity = fox.SceneEntity(
        timestamp=when,
        frame_id=f"{vehicle}/level",
        id=f"{vehicle}/{SURFACE_ID}",
        triangles=[plane],
        metadata=[fox.KeyValuePair(key="height known", value=str(estimate.height_m is not None))],
    )
    return fox.SceneUpdate(entities=[entity])


def ground_level(ground: Ground) -> float | None:
    """Mean height of the known cells in the map's axes, m; None without a map that knows any."""
    cells = cells_of(msgspec.to_builtins(ground))
    known = None if cells is None else cells[1][cells[1] != NO_HEIGHT]
    return None if known is None or not known.size else float(known.mean()) * 1e-3


def ground_map(ground: Ground, vehicle: str, position_ned: tuple[float, float, float]) -> fox.Grid | None:
    """The map's cells with elevation, state and colour, placed by the vehicle's position NED; None without a map."""
    cells, grid = cells_of(msgspec.to_builtins(ground)), ground.map
    if cells is None or grid is None:
        return None
    state, height = cells
    packed = np.zeros(state.shape, CELL)
    packed["elevation"] = np.where(height == NO_HEIGHT, np.nan, height * 1e-3)
    packed["state"] = state
    colours = np.array([MAP_COLOURS[s] for s in CellState], np.uint8)[np.minimum(state, len(MAP_COLOURS) - 1)]
    for k, name in enumerate(("red", "green", "blue", "alpha")):
        packed[name] = colours[..., k]
    north, east, down = position_ned
    corner = (
        north + grid.north0_m - ground.north_m,
        east + grid.east0_m - ground.east_m,
        down - ground.down_m,
    )
    numeric = fox.PackedElementFieldNumericType
    kinds = [numeric.Float32, *[numeric.Uint8] * 5]
    return fox.Grid(
        timestamp=stamp(ground.time_unix_us),
        frame_id=f"{vehicle}/ned",
        # columns go east and rows north, which is x and y of axes whose z is up
        pose=fox.Pose(position=vector(corner), orientation=ENU_FROM_NED),
        column_count=grid.columns,
        cell_size=fox.Vector2(x=grid.cell_m, y=grid.cell_m),
        row_stride=grid.columns * CELL.itemsize,
        cell_stride=CELL.itemsize,
        fields=[
            fox.PackedElementField(name=name, offset=CELL.fields[name][1], type=kind)  # type: ignore[index]
            for name, kind in zip(CELL.names or (), kinds, strict=True)
        ],
        data=packed.tobytes(),
    )


def landing_discs(
    ground: Ground, vehicle: str, position_ned: tuple[float, float, float], level_m: float
) -> fox.SceneUpdate:
    """The landable spots and the disc at the stopping point, as flat cylinders.

    ``level_m``: height of the ground in the map's axes (``ground_level``), at which they are drawn.
    """
    north, east, down = position_ned

    def disc(at: tuple[float, float], radius_m: float, verdict: str) -> fox.CylinderPrimitive:
        place = (north + at[0], east + at[1], down - ground.down_m - level_m)
        return fox.CylinderPrimitive(
            pose=fox.Pose(position=vector(place), orientation=ENU_FROM_NED),
            size=fox.Vector3(x=2 * radius_m, y=2 * radius_m, z=DISC_HEIGHT_M),
            bottom_scale=1.0,
            top_scale=1.0,
            color=DISC_COLOURS.get(verdict, DISC_COLOURS["unknown"]),
        )

    found = [disc((s.north_m, s.east_m), s.radius_m, "landable") for s in ground.spots]
    stop = ground.touchdown
    if stop.north_m is not None and stop.east_m is not None:
        radius_m = ground.spots[0].radius_m if ground.spots else DISC_RADIUS_M
        found.append(disc((stop.north_m, stop.east_m), radius_m, f"touchdown {stop.verdict}"))
    entity = fox.SceneEntity(
        timestamp=stamp(ground.time_unix_us),
        frame_id=f"{vehicle}/ned",
        id=f"{vehicle}/{DISCS_ID}",
        cylinders=found,
        metadata=[fox.KeyValuePair(key="below", value=ground.below.verdict)],
    )
    return fox.SceneUpdate(entities=[entity])


def image(time_unix_us: int, vehicle: str, jpeg: bytes) -> fox.CompressedImage:
    """A JPEG file's bytes as an image of the camera."""
    return fox.CompressedImage(
        timestamp=stamp(time_unix_us), frame_id=f"{vehicle}/camera", data=jpeg, format="jpeg"
    )


def annotations(preview: Preview) -> fox.ImageAnnotations:
    """The tracks as lines over the image, inliers and outliers apart."""
    when = stamp(preview.time_unix_us)
    found = []
    for kind, colour in ((True, INLIER), (False, OUTLIER)):
        ends = [
            fox.Point2(x=x, y=y)
            for (x0, y0, x1, y1), inlier in zip(preview.tracks, preview.inlier, strict=True)
            if inlier is kind
            for x, y in ((x0, y0), (x1, y1))
        ]
        found.append(
            fox.PointsAnnotation(
                timestamp=when,
                type=fox.PointsAnnotationType.LineList,
                points=ends,
                outline_color=colour,
                thickness=1.0,
                metadata=[fox.KeyValuePair(key="tracks", value="inliers" if kind else "outliers")],
            )
        )
    return fox.ImageAnnotations(timestamp=when, points=found)


def calibration(time_unix_us: int, vehicle: str, camera: CameraModel) -> fox.CameraCalibration:
    """The camera's model, as ROS and Foxglove have it."""
    k = camera.matrix
    return fox.CameraCalibration(
        timestamp=stamp(time_unix_us),
        frame_id=f"{vehicle}/camera",
        width=camera.width,
        height=camera.height,
        distortion_model=_distortion_model(camera),
        D=camera.distortion.tolist(),
        K=k.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.hstack([k, np.zeros((3, 1))]).ravel().tolist(),
    )


def _distortion_model(camera: CameraModel) -> str:
    if camera.equidistant:
        return "kannala_brandt"  # Foxglove's name of ROS's equidistant
    return "plumb_bob" if camera.distortion.size <= 5 else "rational_polynomial"


def log(event: Event) -> fox.Log:
    """An event as a line of a log."""
    return fox.Log(
        timestamp=stamp(event.time_unix_us),
        level=LEVELS.get(event.severity, fox.LogLevel.Unknown),
        message=event.text,
        name=event.event,
    )
