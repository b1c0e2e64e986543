"""Camera and link, opened first of all: they come up while the rest of the daemon is still being imported."""

import threading
from collections.abc import Callable
from contextlib import ExitStack

from companion.errors import LandslopeError
from companion.live.inbox import Inbox
from companion.settings.link_options import link_options
from companion.settings.settings import Settings
from drivers.cameras import Camera, CameraFormat, ReaderLimits, open_camera
from drivers.cameras.interface import Notify
from drivers.mavlink.link import Link
from drivers.system.single_instance import SingleInstance, health_path
from drivers.system.state_file import StateFile

OpenCamera = Callable[[Notify], Camera]


class Inputs:
    """What comes in, and the word to stop. ``camera`` opens another camera than ``camera.source`` says.

    Raises an error of the packages for wrong settings, or when a daemon already runs for the vehicle. What comes
    before the daemon takes it waits in the inbox; of the camera's frames the newest.
    """

    def __init__(self, settings: Settings, camera: OpenCamera | None = None) -> None:
        self.stopped = threading.Event()
        self.inbox = Inbox()
        self.link: Link | None = None
        with ExitStack() as stack:
            instance = stack.enter_context(SingleInstance(settings.vehicle.name))
            self.health_file = stack.enter_context(StateFile(health_path(instance.path)))
            if settings.mavlink.connection:
                self.link = Link(link_options(settings), self.inbox.put, self.inbox.report)
                self.link.start()
                stack.callback(self.link.close)
            self.camera = (camera or _camera_of(settings))(self.inbox.wake)
            stack.callback(self.camera.close)
            self._stack = stack.pop_all()

    def stop(self) -> None:
        """Ask the daemon to end; from any thread or signal handler."""
        self.stopped.set()
        self.inbox.wake()

    def close(self) -> None:
        """Close camera and link."""
        self._stack.close()


def _camera_of(settings: Settings) -> OpenCamera:
    c = settings.camera
    if not c.source:
        raise LandslopeError('camera.source is not set: name a camera, as "/dev/video0" or "picamera"')
    wanted = CameraFormat(c.width, c.height, c.rate_hz, c.exposure_us, c.gain, c.pixel_format, c.transport)
    limits = ReaderLimits(open_timeout_s=c.open_timeout_s, read_timeout_s=c.read_timeout_s)
    return lambda notify: open_camera(c.source, wanted, limits, notify)
