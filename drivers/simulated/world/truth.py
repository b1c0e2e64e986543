"""What is true of the ground in view at a pose: the columns of a recorded flight's ``truth.csv``."""

import csv
import math
from collections.abc import Iterable
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.world.render import Renderer

Array = NDArray[np.float64]

COPLANAR_DEG = 0.05
COPLANAR_M = 1e-3


@dataclass(frozen=True, slots=True)
class FrameTruth:
    """Truth of one frame; the plane Z = h + aX + bY under the optical axis in the camera frame.

    ``plane_fraction``: share of the picture in that plane. ``relief``: RMS distance of the visible surface from
    its best-fit plane over ``axis_distance_m``; ``fit_inclination_deg``: that plane's inclination. ``cam_w``:
    camera velocity over the distance along the axis, camera frame, 1/s. (``qw`` .. ``qz``) turn body into NED.
    NaN where the axis meets no ground.
    """

    frame: int
    time_boot_s: float
    pn: float
    pe: float
    pd: float
    qw: float
    qx: float
    qy: float
    qz: float
    vn: float
    ve: float
    vd: float
    axis_distance_m: float
    slope_a: float
    slope_b: float
    inclination_deg: float
    plane_fraction: float
    cam_wx: float
    cam_wy: float
    cam_wz: float
    relief: float
    fit_inclination_deg: float


def quaternion(matrix: Array) -> tuple[float, float, float, float]:
    """(w, x, y, z), w not negative, of a rotation (3, 3)."""
    m = matrix
    squares = np.array([1 + m[0, 0] + m[1, 1] + m[2, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2]])
    squares = np.append(squares, [1 - m[0, 0] + m[1, 1] - m[2, 2], 1 - m[0, 0] - m[1, 1] + m[2, 2]])
    k = int(np.argmax(squares))
    s = 2 * math.sqrt(squares[k])
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    q = (
        np.array(
            [
                [s * s / 4, wx, wy, wz],
                [wx, s * s / 4, xy, xz],
                [wy, xy, s * s / 4, yz],
                [wz, xz, yz, s * s / 4],
            ]
        )[k]
        / s
    )
    w, x, y, z = (q if q[0] >= 0 else -q).tolist()
    return w, x, y, z


def frame_truth(
    renderer: Renderer,
    frame: int,
    time_s: float,
    position: Array,
    ned_from_body: Array,
    velocity_ned: Array,
) -> FrameTruth:
    """The truth at a pose: position (3,) NED, attitude (3, 3), velocity (3,) NED m/s."""
    world, lens = renderer.world, renderer.lens
    ned_from_camera = ned_from_body @ lens.body_from_camera
    pn, pe, pd = (float(v) for v in position)
    vn, ve, vd = (float(v) for v in velocity_ned)
    qw, qx, qy, qz = quaternion(ned_from_body)
    axis = ned_from_camera[:, 2]
    below, distance = renderer.cast(position, axis)
    if below < 0:
        unknown = [math.nan] * 10
        return FrameTruth(frame, time_s, pn, pe, pd, qw, qx, qy, qz, vn, ve, vd, *unknown)
    normal = ned_from_camera.T @ world.normals[below]
    a, b = -normal[0] / normal[2], -normal[1] / normal[2]
    w = ned_from_camera.T @ velocity_ned / distance
    depth, owner = renderer.depth(position, ned_from_camera)
    seen = owner >= 0
    same = world.normals @ world.normals[below] > math.cos(math.radians(COPLANAR_DEG))
    same &= np.abs(world.vertices[:, 0] @ world.normals[below] - world.offsets[below]) < COPLANAR_M
    fraction = float(same[owner[seen]].sum()) / owner.size
    points = renderer.rays()[seen] * depth[seen][:, None]
    centred = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred / len(points))
    fitted = abs(float((ned_from_camera @ vectors[:, 0])[2]))
    return FrameTruth(
        frame=frame,
        time_boot_s=time_s,
        pn=pn,
        pe=pe,
        pd=pd,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        vn=vn,
        ve=ve,
        vd=vd,
        axis_distance_m=distance,
        slope_a=float(a),
        slope_b=float(b),
        inclination_deg=math.degrees(math.acos(min(1.0, abs(float(world.normals[below, 2]))))),
        plane_fraction=fraction,
        cam_wx=float(w[0]),
        cam_wy=float(w[1]),
        cam_wz=float(w[2]),
        relief=math.sqrt(max(float(values[0]), 0.0)) / distance,
        fit_inclination_deg=math.degrees(math.acos(min(1.0, fitted))),
    )


def write_truth(path: Path, rows: Iterable[FrameTruth]) -> None:
    """Write ``truth.csv``."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([f.name for f in fields(FrameTruth)])
        for row in rows:
            writer.writerow([v if isinstance(v, int) else f"{v:.6f}" for v in astuple(row)])
