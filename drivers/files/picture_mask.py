"""A picture that says which pixels never show the ground."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

MAX_BYTES = 16_000_000
_BLACK_BELOW = 128


def write_mask(path: Path, mask: NDArray[np.bool_]) -> None:
    """Replace a file by a mask (height, width) as PNG, black where it is true. Raises OSError.

    It is written beside the file first, so that a crash leaves the old or the new one; after a power cut it may be
    damaged, which reading finds.
    """
    _, data = cv2.imencode(".png", np.where(mask, 0, 255).astype(np.uint8))
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_bytes(data.tobytes())
    temporary.replace(path)


def read_mask(path: Path, width: int, height: int) -> NDArray[np.bool_]:
    """Pixels (height, width) that are black in a picture. Raises DriverError where it is no such mask."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise DriverError(
                f"{path}: larger than {MAX_BYTES // 1_000_000} MB; a mask is a picture of the camera's size"
            )
        raw = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise DriverError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        picture = cv2.imdecode(raw, cv2.IMREAD_GRAYSCALE) if raw.size else None
    except cv2.error:
        picture = None
    if picture is None:
        raise DriverError(
            f"{path}: is no picture; write a PNG of {width} x {height}, black where no ground shows"
        )
    found_height, found_width = picture.shape
    if (found_width, found_height) != (width, height):
        raise DriverError(
            f"{path}: is {found_width} x {found_height}, the camera gives {width} x {height}: "
            "make the mask from a picture of this camera"
        )
    mask = np.asarray(picture < _BLACK_BELOW)
    if mask.all():
        raise DriverError(
            f"{path}: is black everywhere, which leaves no ground to see; white pixels are used"
        )
    return mask
