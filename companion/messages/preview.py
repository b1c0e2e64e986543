"""A small picture with the tracks on it, published only while somebody subscribes."""

import math
from typing import Annotated, Any

import cv2
import msgspec
import numpy as np
import zenoh
from numpy.typing import NDArray

from companion.messages.messages import about
from companion.settings.settings import PreviewSettings
from drivers.bus import Bus
from drivers.samples import Frame
from landing.estimate import SurfaceEstimate

_MICROSECONDS = 1_000_000
_HATCH = 12
"""Distance of the lines over masked parts, px."""


class Preview(msgspec.Struct, frozen=True, kw_only=True):
    """What is drawn over the picture, in raw image pixels; travels as the JPEG's attachment."""

    frame: Annotated[int, about("number of the camera frame")]
    time_unix_us: Annotated[int, about("middle of the exposure, companion clock since 1970", "us")]
    width: Annotated[int, about("width of the camera image; the JPEG is a scaled copy", "px")]
    height: Annotated[int, about("height of the camera image", "px")]
    status: Annotated[str, about('"ok", or why there is no estimate')]
    tracks: Annotated[
        tuple[tuple[float, float, float, float], ...],
        about("each track's place before (x, y) and now (x, y), raw image", "px"),
    ]
    inlier: Annotated[tuple[bool, ...], about("for each track: whether it moves as the plane says")]
    relief: Annotated[
        tuple[float | None, ...],
        about("for each track: height over the plane, over the distance along the axis; null: unknown"),
    ] = ()


def overlay(frame: Frame, estimate: SurfaceEstimate, time_unix_us: int, max_tracks: int) -> Preview:
    """The overlay of a frame; at most ``max_tracks`` tracks, spread evenly over those there are."""
    tracks = estimate.tracks
    height, width = frame.image.shape[:2]
    rows: tuple[tuple[float, float, float, float], ...] = ()
    inlier: tuple[bool, ...] = ()
    relief: tuple[float | None, ...] = ()
    if tracks is not None and len(tracks.current_px):
        step = max(1, -(-len(tracks.current_px) // max_tracks))
        pixels = np.hstack([tracks.previous_px, tracks.current_px])[::step]
        drawable = np.isfinite(pixels).all(axis=1)
        rows = tuple((x0, y0, x1, y1) for x0, y0, x1, y1 in pixels[drawable].round(1).tolist())
        inlier = tuple(tracks.inlier[::step][drawable].tolist())
        heights = tracks.height[::step][drawable].tolist()
        relief = tuple(round(h, 4) if math.isfinite(h) else None for h in heights)
    return Preview(
        frame=frame.number,
        time_unix_us=time_unix_us,
        width=width,
        height=height,
        status=estimate.status,
        tracks=rows,
        inlier=inlier,
        relief=relief,
    )


def shaded(image: NDArray[np.uint8], mask: NDArray[np.bool_] | None) -> NDArray[np.uint8]:
    """The picture (height, width) with what is masked darkened and hatched."""
    if mask is None or mask.shape != image.shape:
        return image
    rows, columns = image.shape
    hatch = (np.arange(rows)[:, None] + np.arange(columns)) % _HATCH < _HATCH // 4
    return np.where(mask, np.where(hatch, 160, image // 3), image).astype(np.uint8)


def jpeg(image: np.ndarray, width_px: int, quality: int) -> bytes:
    """The (height, width[, 3]) uint8 image as JPEG, scaled down to ``width_px``, never up."""
    if image.shape[1] > width_px:
        size = (width_px, max(1, round(image.shape[0] * width_px / image.shape[1])))
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    done, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    # imencode only fails on images it does not know; uint8 grey and BGR are known.
    return data.tobytes() if done else b""


class PreviewPublisher:
    """Publishes ``landslope/<vehicle>/preview``: JPEG payload, the overlay as JSON in the attachment.

    Costs nothing but a comparison a frame while nobody subscribes; at most ``rate_hz`` pictures a second
    of the frames' own time otherwise. The bus may still be looking for its router.
    """

    def __init__(self, bus: Bus, settings: PreviewSettings) -> None:
        self.watched = False
        """Whether somebody subscribes."""
        self.published = 0
        self.unsent = 0
        self._bus = bus
        self._settings = settings
        self._period_us = round(_MICROSECONDS / settings.rate_hz)
        self._due_us: int | None = None
        self._publisher: Any = None
        self._listener: Any = None
        self._declare()

    def set_settings(self, settings: PreviewSettings) -> None:
        """Other rate, size or quality from now on."""
        self._settings = settings
        self._period_us = round(_MICROSECONDS / settings.rate_hz)

    def put(
        self,
        frame: Frame,
        estimate: SurfaceEstimate,
        time_unix_us: int,
        mask: NDArray[np.bool_] | None = None,
    ) -> bool:
        """Publish the frame if somebody watches and a picture is due; returns whether it was published.

        ``mask`` (height, width) is shaded.
        """
        if self._publisher is None:
            self._declare()
        if not self.watched or not self._is_due(frame.arrival_us):
            return False
        settings = self._settings
        picture = jpeg(shaded(frame.image, mask), settings.width_px, settings.jpeg_quality)
        drawn = msgspec.json.encode(overlay(frame, estimate, time_unix_us, settings.max_tracks))
        try:
            self._publisher.put(picture, attachment=drawn)
        except zenoh.ZError:
            self.unsent += 1
            return False
        self.published += 1
        return True

    def close(self) -> None:
        """Stop publishing; to be called before the bus closes."""
        if self._publisher is not None:
            self.watched = False
            self._listener.undeclare()
            self._publisher.undeclare()
            self._publisher = None

    def _declare(self) -> None:
        session = self._bus.session
        if session is None:
            return
        self._publisher = session.declare_publisher(
            self._bus.key("preview"),
            encoding=zenoh.Encoding.IMAGE_JPEG,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.DATA_LOW,
        )
        self._listener = self._publisher.declare_matching_listener(self._matching_changed)
        self.watched = self._publisher.matching_status.matching

    def _matching_changed(self, status: zenoh.MatchingStatus) -> None:
        self.watched = status.matching

    def _is_due(self, now_us: int) -> bool:
        due = self._due_us
        # Far before the due time means a clock that was set back: start over.
        if due is not None and due - self._period_us <= now_us < due:
            return False
        late = due is None or not 0 <= now_us - due < self._period_us
        self._due_us = (now_us if late or due is None else due) + self._period_us
        return True
