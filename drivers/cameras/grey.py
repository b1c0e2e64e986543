"""Whatever a capture hands over, as a grey picture."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError

JPEG_END = b"\xff\xd9"
PADDING = 4096
"""Bytes behind a JPEG's end in which the end marker is looked for: cameras fill their buffers up."""
MOST_BROKEN = 30
"""JPEGs in a row that may be broken before the camera counts as lost."""


def grey_of(image: NDArray[Any], height: int = 0, luma: int = 0) -> NDArray[np.uint8]:
    """(height, width) uint8 contiguous grey.

    ``image`` is grey, BGR(A), packed YUV 4:2:2 (two channels, luma in channel ``luma``) or planar YUV 4:2:0 (grey rows,
    then chroma: ``height`` is where the grey ends). Raises DriverError for anything else.
    """
    if image.ndim == 2:
        return np.ascontiguousarray(image[:height] if height else image)
    if image.ndim == 3 and image.shape[2] == 1:
        return np.ascontiguousarray(image[..., 0])
    if image.ndim == 3 and image.shape[2] == 2:
        return np.ascontiguousarray(image[..., luma])
    if image.ndim == 3 and image.shape[2] in (3, 4):
        code = cv2.COLOR_BGR2GRAY if image.shape[2] == 3 else cv2.COLOR_BGRA2GRAY
        return cv2.cvtColor(image, code).astype(np.uint8, copy=False)
    raise DriverError(f"the camera gives pictures of shape {image.shape}; grey, YUV or BGR is needed")


def grey_of_jpeg(data: NDArray[np.uint8]) -> NDArray[np.uint8] | None:
    """(height, width) uint8 grey of a JPEG as the camera sent it: its luma alone is decoded.

    None where it is broken: a decoder fills what a cut picture lacks, and such ground would be flat.
    """
    jpeg = data.reshape(-1)
    if JPEG_END not in jpeg[-PADDING:].tobytes():
        return None
    image = cv2.imdecode(jpeg, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if image is None else np.asarray(image, np.uint8)
