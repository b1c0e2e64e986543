"""A step edge (drop-off) that enters the view, by the mean height of the young tracks behind it.

Where the ground is faint, tracks that have just come in know their heights to a few hundredths of the distance only. A
step along a side of the view has all of them on one level, and their mean is far better known.
"""

import numpy as np
from numpy.typing import NDArray

from landing.ground.border import SIDES
from landing.ground.roughness import Relief
from landing.options import EstimatorOptions
from landing.vision.camera import CameraModel


class DropOff:
    """Means of the heights of the tracks nearest to a side, as far in as they say most."""

    def __init__(self, options: EstimatorOptions, camera: CameraModel) -> None:
        self.options, self._size = options, (camera.width, camera.height)

    def step(self, relief: Relief, pixels: NDArray[np.floating], sides: set[int]) -> float:
        """Contribution to the view's mean square height of the most significant step edge; 0 where none is significant.

        ``pixels`` (n, 2) are the places of the relief's tracks, ``sides`` the numbers (``border.SIDES``) of those at
        which ground comes in. Heights have a common error as well (``drop_off_floor``), since tracks of one age share
        their older picture.
        """
        o, most = self.options, 0.0
        information = 1 / (relief.std**2 + o.drop_off_floor**2)
        for axis, far in (SIDES[number] for number in sides):
            place = pixels[:, axis]
            depth = (self._size[axis] - 1 - place if far else place) / self._size[axis]
            order = depth.argsort(kind="stable")[: np.count_nonzero(depth < o.drop_off_share)]
            if len(order) < o.drop_off_tracks:
                continue
            known = information[order]
            total = known.cumsum()
            mean = (known * relief.height[order]).cumsum() / total
            sure = np.abs(mean) * np.sqrt(total) > o.drop_off_sigmas
            sure[: o.drop_off_tracks - 1] = False
            most = max(most, float(np.where(sure, mean * mean * depth[order], 0.0).max()))
        return most
