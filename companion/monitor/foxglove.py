"""Vehicles live in the Foxglove app, through the SDK's own server."""

import signal
import threading
from collections.abc import Callable

import cv2
import foxglove
import msgspec
import numpy as np

from companion.errors import LandslopeError
from companion.export.channels import VehicleChannels
from companion.messages.messages import Decision, Estimate, Event, Health
from companion.messages.preview import Preview
from companion.monitor.feed import Feed
from companion.monitor.options import MonitorOptions
from companion.monitor.state import Watch
from drivers.bus import Delivery, Endpoints

WANTED_POLL_S = 0.5
NAME = "landslope"


class FoxgloveFeed:
    """Logs what the watch takes into a context, one set of channels a vehicle."""

    def __init__(self, watch: Watch, context: foxglove.Context) -> None:
        self._watch = watch
        self._context = context
        self._channels: dict[str, VehicleChannels] = {}
        watch.listeners.append(self._take)

    @property
    def pictures_wanted(self) -> bool:
        """Whether an onlooker shows a camera."""
        return any(channels.pictures_wanted for channels in list(self._channels.values()))

    def _take(self, vehicle: str, message: object) -> None:
        channels = self._channels.get(vehicle)
        if channels is None:
            channels = self._channels[vehicle] = VehicleChannels(self._context, vehicle)
        if isinstance(message, Estimate | Decision | Health | Event):
            channels.message(message)
        elif isinstance(message, Delivery):
            preview = self._watch.vehicles[vehicle].preview
            drawn = None if preview is None else scaled(preview, message.payload)
            if drawn is not None:
                channels.picture(message.payload, drawn)


def scaled(preview: Preview, jpeg: bytes) -> Preview | None:
    """The overlay in the JPEG's own pixels, which may be a smaller copy; None if it is no JPEG."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE) if jpeg else None
    if image is None or preview.width <= 0:
        return None
    factor = image.shape[1] / preview.width
    if factor == 1:
        return preview
    tracks = tuple((x0 * factor, y0 * factor, x1 * factor, y1 * factor) for x0, y0, x1, y1 in preview.tracks)
    return msgspec.structs.replace(preview, width=image.shape[1], height=image.shape[0], tracks=tracks)


def start(
    options: MonitorOptions, endpoints: Endpoints, vehicle: str, host: str, port: int
) -> tuple[foxglove.WebSocketServer, Callable[[], None]]:
    """The server, and what ends it. Raises LandslopeError when the port is taken."""
    context = foxglove.Context()
    watch = Watch(options)
    feed = FoxgloveFeed(watch, context)
    try:
        server = foxglove.start_server(name=NAME, host=host, port=port, context=context)
    except (OSError, RuntimeError, OverflowError) as error:
        raise LandslopeError(f"cannot serve on {host}:{port}: {error}; choose another --port") from None
    bus = Feed(watch, endpoints, vehicle)
    stop = threading.Event()

    def follow_onlookers() -> None:
        while not stop.wait(WANTED_POLL_S):
            (bus.look if feed.pictures_wanted else bus.look_away)(NAME)

    follower = threading.Thread(target=follow_onlookers, name="foxglove-onlookers", daemon=True)
    follower.start()

    def end() -> None:
        stop.set()
        follower.join()
        bus.close()
        server.stop()

    return server, end


def serve(options: MonitorOptions, endpoints: Endpoints, vehicle: str, host: str, port: int) -> int:
    """Serve until interrupted."""
    interrupted = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: interrupted.set())
    server, end = start(options, endpoints, vehicle, host, port)
    print(
        f"landslope monitor: open ws://{host}:{server.port} in the Foxglove app  (Ctrl-C ends it)", flush=True
    )
    interrupted.wait()
    end()
    return 0
