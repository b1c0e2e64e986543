"""The surface as a tilted plane under the vehicle, in perspective, as SVG."""

import math

import numpy as np
from numpy.typing import NDArray

from companion.messages.messages import Estimate
from companion.messages.tilt import Tilt, tilt_of
from landing.rotations import matrix_from_euler

WIDTH, HEIGHT = 400, 300
GRID_LINES = 7
HALF_SIDE = 1.0
"""Half side of the plane over the distance to it."""
EYE = np.array((-3.4, 1.7, -1.15))
LOOK_AT = np.array((0.0, 0.0, 0.55))
FOCAL = 440.0
ARM = 0.34
COLOURS = {"fit": "#008a3a", "unfit": "#d4152f", "unknown": "#7a7a7a", "caution": "#c79400"}


def scene_svg(estimate: Estimate | None, verdict: str) -> str:
    """The picture; the vehicle's nose points away from the onlooker. Only numbers of ours go into the SVG."""
    parts = [_plane(Tilt(0.0, 0.0), "#9a9a9a", "none", dashed=True)]
    tilt = None if estimate is None else tilt_of(estimate)
    angle = ""
    if tilt is not None:
        colour = COLOURS.get(verdict, COLOURS["unknown"])
        parts.append(_plane(tilt, colour, colour, dashed=False))
        parts.append(_normal(tilt, colour))
        angle = f' data-ahead="{tilt.ahead:.4f}" data-right="{tilt.right:.4f}"'
    roll = 0.0 if estimate is None or estimate.roll_deg is None else estimate.roll_deg
    pitch = 0.0 if estimate is None or estimate.pitch_deg is None else estimate.pitch_deg
    parts.append(_vehicle(math.radians(roll), math.radians(pitch)))
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="100%" role="img" class="scene"{angle}'
        f' aria-label="the surface under the vehicle">{"".join(parts)}</svg>'
    )


def project(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) forward, right, down -> (n, 2) picture, x right and y down, for the fixed onlooker."""
    axis = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
    right = np.cross((0.0, 0.0, 1.0), axis)
    right /= np.linalg.norm(right)
    down = np.cross(axis, right)
    seen = (points - EYE) @ np.stack((right, down, axis), axis=1)
    depth = np.maximum(seen[:, 2:], 0.1)
    return seen[:, :2] / depth * FOCAL + np.array((WIDTH / 2, HEIGHT / 2))


def _on_plane(tilt: Tilt, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack((x, y, 1 + tilt.ahead * x + tilt.right * y), axis=1)


def _plane(tilt: Tilt, stroke: str, fill: str, *, dashed: bool) -> str:
    # A steep plane is drawn smaller, so that it keeps its area and stays in the picture.
    half = HALF_SIDE / math.sqrt(1 + tilt.ahead**2 + tilt.right**2)
    edge = np.linspace(-half, half, GRID_LINES)
    low, high = np.full(GRID_LINES, -half), np.full(GRID_LINES, half)
    lines = []
    for start, end in (
        (_on_plane(tilt, edge, low), _on_plane(tilt, edge, high)),
        (_on_plane(tilt, low, edge), _on_plane(tilt, high, edge)),
    ):
        for (x0, y0), (x1, y1) in zip(project(start), project(end), strict=True):
            lines.append(f"M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}")
    corners = project(
        _on_plane(tilt, np.array((-half, half, half, -half)), np.array((-half, -half, half, half)))
    )
    outline = " ".join(f"{x:.1f},{y:.1f}" for x, y in corners)
    dash = ' stroke-dasharray="4 5"' if dashed else ""
    return (
        f'<polygon points="{outline}" fill="{fill}" fill-opacity="0.22" stroke="{stroke}" stroke-width="2"{dash}/>'
        f'<path d="{"".join(lines)}" stroke="{stroke}" stroke-width="{1 if dashed else 1.6}" fill="none"{dash}/>'
    )


def _normal(tilt: Tilt, colour: str) -> str:
    up = np.array((tilt.ahead, tilt.right, -1.0)) / math.sqrt(1 + tilt.ahead**2 + tilt.right**2)
    foot = np.array((0.0, 0.0, 1.0))
    (x0, y0), (x1, y1) = project(np.stack((foot, foot + 0.55 * up)))
    return (
        f'<path d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}" stroke="{colour}" stroke-width="5"'
        f' stroke-linecap="round"/><circle cx="{x0:.1f}" cy="{y0:.1f}" r="5" fill="{colour}"/>'
    )


def _vehicle(roll: float, pitch: float) -> str:
    level_from_body = matrix_from_euler(roll, pitch, 0.0)
    tips = np.array([(dx * ARM, dy * ARM, 0.0) for dx, dy in ((1, 1), (1, -1), (-1, -1), (-1, 1))])
    nose = np.array([(0.0, 0.0, 0.0), (1.4 * ARM, 0.0, 0.0)])
    turn = np.linspace(0, 2 * math.pi, 17)
    parts = []
    for tip in tips:
        disc = tip + 0.6 * ARM * np.stack((np.cos(turn), np.sin(turn), 0 * turn), axis=1)
        ring = " ".join(f"{x:.1f},{y:.1f}" for x, y in project(disc @ level_from_body.T))
        parts.append(f'<polygon points="{ring}" class="rotor" stroke-width="2"/>')
    for bar, look in (
        (tips[::2], ("currentColor", 4)),
        (tips[1::2], ("currentColor", 4)),
        (nose, ("#2f7de0", 6)),
    ):
        (x0, y0), (x1, y1) = project(bar @ level_from_body.T)
        colour, width = look
        parts.append(
            f'<path d="M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}" stroke="{colour}" stroke-width="{width}"/>'
        )
    return "".join(parts)
