"""What was found to stand still in the picture, kept on disk from flight to flight."""

import hashlib
import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from companion.settings.link_options import state_directory
from companion.settings.settings import CameraSettings
from drivers.errors import DriverError
from drivers.files.picture_mask import read_mask, write_mask

log = logging.getLogger(__name__)

Mask = NDArray[np.bool_]

_SAVED_EVERY_US = 10_000_000


class KeptMask:
    """One PNG, black where the picture stands still, in the service's state directory.

    It belongs to one camera, calibration and mount, which its name has a fingerprint of, and to one picture size.
    Failures are logged once, never raised: the mask is found again within seconds of flight.
    """

    def __init__(self, camera: CameraSettings, directory: Path | None = None) -> None:
        folder = state_directory() if directory is None else directory
        self.path = folder / f"mask_{_fingerprint(camera)}.png"
        self._saved: Mask | None = None
        self._due_us = 0
        self._complained = False

    def load(self, width: int, height: int) -> Mask | None:
        """Pixels (height, width) that stood still; None where nothing fits this camera and size."""
        if not self.path.exists():
            return None
        try:
            self._saved = read_mask(self.path, width, height)
        except DriverError as error:
            self._complain(str(error))
            return None
        return self._saved

    def save(self, mask: Mask | None, now_us: int, always: bool = False) -> None:
        """Keep a changed mask, now and then, or ``always``."""
        if mask is None or mask is self._saved or (now_us < self._due_us and not always):
            return
        if self._saved is None and not mask.any():
            return
        self._due_us = now_us + _SAVED_EVERY_US
        self._saved = mask
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_mask(self.path, mask)
        except OSError as error:
            self._complain(f"{self.path}: cannot be written: {error.strerror or error}")

    def _complain(self, text: str) -> None:
        if not self._complained:
            self._complained = True
            log.warning("%s; what stands still in the picture is found anew", text)


def _fingerprint(camera: CameraSettings) -> str:
    """Distinguishes cameras, their calibrations and mounts."""
    mount = camera.mount_roll_deg, camera.mount_pitch_deg, camera.mount_yaw_deg
    text = repr((camera.source, camera.calibration, camera.pixel_format, mount))
    return hashlib.sha256(text.encode()).hexdigest()[:12]
