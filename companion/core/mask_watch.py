"""How much of the picture does not show the ground, and events when that changes."""

from companion.messages.events import event
from companion.messages.messages import Event
from landing.vision.camera import CameraModel

_CHANGE = 0.02
"""Share of the picture whose coming or going is reported."""


class MaskWatch:
    """Looks at the camera's mask after every frame: what is set with what is found."""

    def __init__(self, camera: CameraModel) -> None:
        self._camera = camera
        self._mask = camera.mask
        self.share = self._reported = 0.0 if camera.mask is None else float(camera.mask.mean())

    def step(self, frame: int, time_unix_us: int) -> list[Event]:
        """What changed with this frame."""
        if self._camera.mask is self._mask:
            return []
        self._mask = self._camera.mask
        self.share = 0.0 if self._mask is None else float(self._mask.mean())
        if abs(self.share - self._reported) < _CHANGE and (self.share > 0) == (self._reported > 0):
            return []
        more, self._reported = self.share > self._reported, self.share
        name = "mask_grown" if more else "mask_shrunk"
        text = f"{100 * self.share:.0f} % of the picture does not show the ground"
        return [event(name, frame, time_unix_us, text, {"share": round(self.share, 4)})]
