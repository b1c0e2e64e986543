"""Whatever a capture hands over, as a grey picture."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.errors import DriverError


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
