"""What the software saw, drawn on the frame: tracks, the surface as a tilted grid, and the verdict in words."""

import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from companion.messages.ground import Ground
from companion.messages.messages import Decision
from companion.replay.overlay_ground import DISC_COLOURS, draw_disc, relief_colour
from companion.replay.procedure_spans import steered
from drivers.files.video_writer import VideoWriter, open_video
from landing.estimate import SurfaceEstimate
from landing.reasons import in_words
from landing.vision.camera import CameraModel

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

SHOWN_WIDTH_PX = 960
"""Smaller frames are enlarged by a whole factor to about this width, so that text can be read."""

COLOURS: dict[str, Colour] = {"fit": (79, 158, 46), "unfit": (63, 73, 209), "unknown": (130, 125, 120)}
WORDS = {"fit": "FIT FOR LANDING", "unfit": "NOT FIT", "unknown": "UNKNOWN"}
INLIER: Colour = (90, 220, 120)
OUTLIER: Colour = (60, 110, 255)
WHITE: Colour = (255, 255, 255)
SPOT: Colour = (255, 90, 200)
FONT = cv2.FONT_HERSHEY_SIMPLEX
GRID_LINES = 7
GRID_SHARE = 0.62
"""Half side of the grid over half the height of the view, when the surface faces the camera."""
REQUEST_SHOWN_S = 2.5
PENDING_FRAMES = 10
DEFAULT_FPS = 30.0


@dataclass(frozen=True, slots=True)
class Scene:
    """What a picture says beside the estimate."""

    decision: Decision | None
    time_s: float
    requested_s: float | None = None
    """Time of the request to land, None before it."""
    ground: Ground | None = None
    """The newest of the ground map: the verdict on the disc straight below."""
    radius_m: float = math.nan
    """Of that disc."""


def draw(image: Image, estimate: SurfaceEstimate, camera: CameraModel, scene: Scene) -> Image:
    """The picture (height, width, 3) BGR for a grey frame (height, width)."""
    scale = max(1, round(SHOWN_WIDTH_PX / image.shape[1]))
    grey = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    picture: Image = cv2.cvtColor(cv2.convertScaleAbs(grey, alpha=0.8), cv2.COLOR_GRAY2BGR).astype(np.uint8)
    verdict = scene.decision.verdict if scene.decision else "unknown"
    _draw_tracks(picture, estimate, scale)
    if estimate.status == "ok":
        _draw_surface(picture, estimate, camera, scale, COLOURS[verdict])
        _draw_side_view(picture, estimate, COLOURS[verdict])
        if scene.ground is not None:
            up = _vertical(estimate, camera)
            shade = DISC_COLOURS.get(scene.ground.below.verdict, DISC_COLOURS["unknown"])
            draw_disc(picture, estimate, camera, scale, up, scene.radius_m, shade)
        _draw_spot(picture, estimate, camera, scale, scene)
    _draw_banner(picture, verdict, scene, reasons(estimate, scene.decision))
    _draw_figures(picture, estimate, scene)
    _draw_procedure(picture, scene.decision)
    return picture


class OverlayWriter:
    """Writes the pictures as a video that browsers play, at the frames' own rate.

    ``width_px`` scales the pictures down to that width. Raises DriverError when the file cannot be written.
    """

    def __init__(
        self, path: Path, camera: CameraModel, width_px: int | None = None, radius_m: float = math.nan
    ) -> None:
        self.fps = DEFAULT_FPS
        """Pictures a second, known once some have been seen."""
        self._path = path
        self._camera = camera
        self._width_px = width_px
        self._writer: VideoWriter | None = None
        self._pending: list[Image] = []
        self._times: list[float] = []
        self._decision: Decision | None = None
        self._ground: Ground | None = None
        self._radius_m = radius_m
        self._requested_s: float | None = None

    def decided(self, decision: Decision) -> None:
        """The decision in force from now on."""
        self._decision = decision

    def mapped(self, ground: Ground) -> None:
        """What the ground map says from now on."""
        self._ground = ground

    def requested(self, time_s: float) -> None:
        """A landing was requested."""
        self._requested_s = time_s

    def add(self, image: Image, estimate: SurfaceEstimate, time_s: float) -> None:
        """Draw one frame."""
        picture = draw(
            image,
            estimate,
            self._camera,
            Scene(self._decision, time_s, self._requested_s, self._ground, self._radius_m),
        )
        if self._width_px is not None and picture.shape[1] > self._width_px:
            size = (self._width_px, round(picture.shape[0] * self._width_px / picture.shape[1]))
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        if self._writer is None:
            # The rate is known only once some frames have been seen.
            self._pending.append(picture)
            self._times.append(time_s)
            if len(self._pending) >= PENDING_FRAMES:
                self._open()
        else:
            self._writer.write(picture)

    def close(self) -> None:
        """Finish the file; without a picture there is none."""
        if self._writer is None and self._pending:
            self._open()
        if self._writer is not None:
            writer, self._writer = self._writer, None
            writer.close()

    def _open(self) -> None:
        steps = np.diff(self._times)
        self.fps = 1 / float(np.median(steps)) if steps.size and np.median(steps) > 0 else DEFAULT_FPS
        height, width = self._pending[0].shape[:2]
        self._writer = open_video(self._path, self.fps, width, height)
        for picture in self._pending:
            self._writer.write(picture)
        self._pending.clear()


def _draw_tracks(picture: Image, estimate: SurfaceEstimate, scale: int) -> None:
    tracks = estimate.tracks
    if tracks is None:
        return
    ends = (np.stack((tracks.previous_px, tracks.current_px), axis=1) + 0.5) * scale - 0.5
    for fits in (True, False):
        chosen = ends[tracks.inlier == fits]
        colour = INLIER if fits else OUTLIER
        chosen = chosen[np.isfinite(chosen).all(axis=(1, 2))]
        for start, end in np.rint(chosen).astype(int):
            cv2.line(picture, tuple(start.tolist()), tuple(end.tolist()), colour, 1, cv2.LINE_AA)
    shown = np.isfinite(ends).all(axis=(1, 2))
    for end, height, fits in zip(ends[shown, 1], tracks.height[shown], tracks.inlier[shown], strict=True):
        at = tuple(np.rint(end).astype(int).tolist())
        cv2.circle(picture, at, 4, relief_colour(float(height), bool(fits), OUTLIER), -1, cv2.LINE_AA)


def _draw_surface(
    picture: Image, estimate: SurfaceEstimate, camera: CameraModel, scale: int, colour: Colour
) -> None:
    """A square of the surface under the axis, its normal, and the vertical, in perspective."""
    up = np.array(
        (math.tan(math.radians(estimate.slope_x_deg)), math.tan(math.radians(estimate.slope_y_deg)), -1.0)
    )
    up /= np.linalg.norm(up)
    foot = np.array((0.0, 0.0, 1.0))
    across = np.cross((0.0, 1.0, 0.0), up)
    across /= np.linalg.norm(across)
    along = np.cross(up, across)
    half = GRID_SHARE * camera.height / 2 / camera.focal_px

    def pixels(points: NDArray[np.float64]) -> NDArray[np.int32] | None:
        if (points[:, 2] < 0.05).any():
            return None
        px = camera.project(points[:, :2] / points[:, 2:])
        return np.rint((px + 0.5) * scale - 0.5).astype(np.int32)

    steps = np.linspace(-half, half, GRID_LINES)
    fine = np.linspace(-half, half, 17)[:, None]
    lines = [pixels(foot + s * across + fine * along) for s in steps]
    lines += [pixels(foot + fine * across + s * along) for s in steps]
    corners = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    outline = pixels(foot + corners[:, :1] * across + corners[:, 1:] * along)
    if outline is None or any(line is None for line in lines):
        return
    tinted = picture.copy()
    cv2.fillPoly(tinted, [outline], colour)
    cv2.addWeighted(tinted, 0.28, picture, 0.72, 0, dst=picture)
    bright = tuple(min(255, c + 70) for c in colour)
    cv2.polylines(picture, [line for line in lines if line is not None], False, bright, 1, cv2.LINE_AA)
    cv2.polylines(picture, [outline], True, bright, 3, cv2.LINE_AA)
    vertical = _vertical(estimate, camera)
    for direction, shade, thickness in ((vertical, WHITE, 2), (up, bright, 4)):
        arrow = None if direction is None else pixels(np.stack((foot, foot + 1.1 * half * direction)))
        if arrow is not None:
            cv2.arrowedLine(
                picture,
                tuple(arrow[0].tolist()),
                tuple(arrow[1].tolist()),
                shade,
                thickness,
                cv2.LINE_AA,
                0,
                0.12,
            )


def _vertical(estimate: SurfaceEstimate, camera: CameraModel) -> NDArray[np.float64] | None:
    """Upwards in the camera frame (3,), None without attitude."""
    if not (math.isfinite(estimate.roll_deg) and math.isfinite(estimate.pitch_deg)):
        return None
    roll, pitch = math.radians(estimate.roll_deg), math.radians(estimate.pitch_deg)
    up_body = np.array(
        (math.sin(pitch), -math.sin(roll) * math.cos(pitch), -math.cos(roll) * math.cos(pitch))
    )
    return camera.body_from_camera.T @ up_body


def _draw_side_view(picture: Image, estimate: SurfaceEstimate, colour: Colour) -> None:
    """The inclination seen from the side: the surface against a level line."""
    if not math.isfinite(estimate.inclination_deg):
        return
    height, width = picture.shape[:2]
    unit = height // 12
    base = int(2.8 * unit)
    x0, y0 = width - base - unit // 2, height - height // 12 - unit // 2
    angle = math.radians(min(estimate.inclination_deg, 75.0))
    length = base * min(1.0, 0.7 / max(math.tan(angle), 1e-6))
    tip = (int(x0 + length), int(y0 - length * math.tan(angle)))
    panel = picture.copy()
    cv2.rectangle(
        panel, (x0 - unit // 2, y0 - int(3.0 * unit)), (width - 1, y0 + unit // 2), (25, 25, 25), -1
    )
    cv2.addWeighted(panel, 0.7, picture, 0.3, 0, dst=picture)
    cv2.fillPoly(picture, [np.array(((x0, y0), (tip[0], y0), tip), np.int32)], colour, cv2.LINE_AA)
    cv2.line(picture, (x0, y0), (x0 + base, y0), WHITE, 2, cv2.LINE_AA)
    cv2.line(picture, (x0, y0), tip, tuple(min(255, c + 70) for c in colour), 4, cv2.LINE_AA)
    _text(picture, f"{estimate.inclination_deg:.0f}°", (x0, y0 - int(2.1 * unit)), 0.002 * height, WHITE)


def reasons(estimate: SurfaceEstimate, decision: Decision | None) -> tuple[str, ...]:
    """What stands against landing: in this frame, or else in the decision, which may be some frames old."""
    if decision is None:
        return ()
    return in_words(estimate.against_flat) if decision.reasons and estimate.against_flat else decision.reasons


def _draw_banner(picture: Image, verdict: str, scene: Scene, against: tuple[str, ...]) -> None:
    height, width = picture.shape[:2]
    bar = height // 11
    cv2.rectangle(picture, (0, 0), (width, bar), COLOURS[verdict], -1)
    _text(picture, WORDS[verdict], (bar // 3, int(0.72 * bar)), 0.0016 * height, WHITE, 3)
    if against:
        left = bar // 3 + int(0.028 * height * len(WORDS[verdict])) + bar // 2
        _text(
            picture,
            _fitting("; ".join(reason.partition(",")[0] for reason in against), width - left, 0.001 * height),
            (left, int(0.68 * bar)),
            0.001 * height,
            WHITE,
        )
    if scene.requested_s is not None and 0 <= scene.time_s - scene.requested_s <= REQUEST_SHOWN_S:
        words, size = "LANDING REQUESTED", 0.0026 * height
        (w, h), _ = cv2.getTextSize(words, FONT, size, 4)
        at = ((width - w) // 2, 2 * bar + h)
        cv2.rectangle(picture, (at[0] - 15, at[1] - h - 15), (at[0] + w + 15, at[1] + 18), COLOURS["fit"], -1)
        _text(picture, words, at, size, WHITE, 4)


def _draw_procedure(picture: Image, decision: Decision | None) -> None:
    """What the landing procedure does, below the verdict; nothing where there is none."""
    doing = None if decision is None else steered(decision)
    if doing is None:
        return
    height, width = picture.shape[:2]
    bar, size = height // 16, 0.0009 * height
    top = height // 11
    cv2.rectangle(picture, (0, top), (width, top + bar), (120, 80, 40), -1)
    words = f"{doing.state.replace('_', ' ')}: {doing.text}"
    if doing.spot_north_m is not None and doing.spot_east_m is not None:
        words += f" ({doing.spot_north_m:.1f} m north, {doing.spot_east_m:.1f} m east)"
    words = _fitting(words, width - 2 * (bar // 3), size)
    _text(picture, words, (bar // 3, top + int(0.7 * bar)), size, WHITE)


def _draw_spot(
    picture: Image, estimate: SurfaceEstimate, camera: CameraModel, scale: int, scene: Scene
) -> None:
    """The disc of the place that the landing procedure has chosen."""
    doing = None if scene.decision is None else steered(scene.decision)
    if doing is None or doing.spot_ahead_m is None or doing.spot_right_m is None:
        return
    aside_m = doing.spot_ahead_m, doing.spot_right_m
    up = _vertical(estimate, camera)
    for radius_m in (scene.radius_m, 0.1 * scene.radius_m):
        draw_disc(picture, estimate, camera, scale, up, radius_m, SPOT, aside_m)


def _draw_figures(picture: Image, estimate: SurfaceEstimate, scene: Scene) -> None:
    height, width = picture.shape[:2]
    bar = height // 12
    cv2.rectangle(picture, (0, height - bar), (width, height), (25, 25, 25), -1)
    if estimate.status == "ok":
        parts = [_figure("inclination", estimate.inclination_deg, 1, "°", estimate.inclination_std_deg)]
        parts.append(_figure("roughness", estimate.roughness, 3, ""))
        if 0 < estimate.time_to_contact_s < 60:
            parts.append(_figure("contact in", estimate.time_to_contact_s, 1, " s"))
    else:
        parts = ["no estimate: " + estimate.status.replace("_", " ")]
    _text(picture, "   ".join(filter(None, parts)), (bar // 3, height - bar // 3), 0.00115 * height, WHITE)
    clock = f"{scene.time_s:.1f} s"
    _text(
        picture, clock, (width - int(0.024 * height * len(clock)), height - bar // 3), 0.00115 * height, WHITE
    )


def _figure(name: str, value: float, digits: int, unit: str, std: float = math.nan) -> str:
    if not math.isfinite(value):
        return ""
    spread = f" ± {std:.{digits}f}" if math.isfinite(std) else ""
    return f"{name} {value:.{digits}f}{spread}{unit}"


def _fitting(words: str, width_px: int, size: float) -> str:
    while words and cv2.getTextSize(words, FONT, size, 1)[0][0] > width_px:
        words = words[:-4].rstrip(" .") + "..."
        if len(words) < 8:
            return ""
    return words


def _text(
    picture: Image, words: str, at: tuple[int, int], size: float, colour: Colour, thickness: int = 2
) -> None:
    cv2.putText(picture, words, at, FONT, size, colour, max(1, thickness - 1), cv2.LINE_AA)
