"""The checks that every live frame passes before anybody sees it."""

import numpy as np
from numpy.typing import NDArray

from drivers.refusals import RefusalCode
from drivers.samples import Frame, Refusal

SIZE_WITNESSES = 15
"""Frames of another size in a row that are refused before that size is taken for the camera's."""


class FrameCheck:
    """Refuses frames that would mislead: another size, a repeated picture, a stamp that does not move forward.

    The first frame sets the size, for the calibration holds for one size alone; another one is taken only after
    SIZE_WITNESSES frames of it in a row: a camera that came up wrongly once must not be lost for good.
    A camera that hangs often repeats its last picture bit for bit; sensor noise forbids that to a living one.
    """

    def __init__(self, source: str = "camera") -> None:
        self._source = source
        self._size: tuple[int, ...] | None = None
        self._other_size: tuple[int, ...] | None = None
        self._other_count = 0
        self._stamp_us: int | None = None
        self._image: NDArray[np.uint8] | None = None

    def check(self, frame: Frame) -> Frame | Refusal:
        """The frame itself, or why it is refused."""
        refusal = self._fault(frame)
        if refusal is not None:
            return refusal
        self._size, self._other_size, self._other_count = frame.image.shape, None, 0
        self._stamp_us = frame.stamp_us
        self._image = frame.image
        return frame

    def _fault(self, frame: Frame) -> Refusal | None:
        image = frame.image
        if image.ndim != 2 or image.size == 0 or image.dtype != np.uint8:
            return self._refuse(frame, RefusalCode.BAD_PICTURE, f"shape {image.shape}, type {image.dtype}")
        if self._size is not None and image.shape != self._size and not self._size_changes(image.shape):
            now, then = image.shape[::-1], self._size[::-1]
            return self._refuse(
                frame, RefusalCode.SIZE_CHANGED, f"{now[0]} x {now[1]} instead of {then[0]} x {then[1]}"
            )
        if self._stamp_us is not None and frame.stamp_us <= self._stamp_us:
            repeated = frame.stamp_us == self._stamp_us
            reason = RefusalCode.REPEATED_STAMP if repeated else RefusalCode.BACKWARD_STAMP
            return self._refuse(frame, reason, f"{frame.stamp_us - self._stamp_us} us after the frame before")
        if self._image is not None and _same(image, self._image):
            return self._refuse(frame, RefusalCode.PICTURE_REPEATED, "the same picture again, bit for bit")
        return None

    def _size_changes(self, size: tuple[int, ...]) -> bool:
        """Whether the last frames all had this other size."""
        self._other_count = self._other_count + 1 if size == self._other_size else 1
        self._other_size = size
        return self._other_count > SIZE_WITNESSES

    def _refuse(self, frame: Frame, reason: RefusalCode, detail: str) -> Refusal:
        return Refusal(frame.arrival_us, self._source, reason, f"frame {frame.number}: {detail}")


def _same(image: NDArray[np.uint8], before: NDArray[np.uint8]) -> bool:
    """Whether two pictures are equal bit for bit; one row of them nearly always says that they are not."""
    if image.shape != before.shape:
        return False
    row = len(image) // 2
    return np.array_equal(image[row], before[row]) and np.array_equal(image, before)
