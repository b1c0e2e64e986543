"""Changes of what is masked are reported when they are large, or when a mask begins or ends."""

import numpy as np

from companion.core.mask_watch import MaskWatch
from landing.vision.camera import CameraModel


def masked(share: float) -> np.ndarray:
    mask = np.zeros((100, 100), bool)
    mask[: round(100 * share)] = True
    return mask


def test_events_and_share() -> None:
    camera = CameraModel.from_focal(100, 100, 90.0)
    watch = MaskWatch(camera)
    names = []
    for frame, share in enumerate((0, 0.1, 0.11, 0.2, 0.19, 0.1, 0.01, 0)):
        camera.mask = masked(share) if share else None
        for event in watch.step(frame, frame):
            names.append((frame, event.event, event.details["share"]))
            assert f"{100 * share:.0f} %" in event.text
        assert watch.share == share
    assert names == [
        (1, "mask_grown", 0.1),
        (3, "mask_grown", 0.2),
        (5, "mask_shrunk", 0.1),
        (6, "mask_shrunk", 0.01),
        (7, "mask_shrunk", 0.0),
    ]


def test_a_mask_that_is_set_is_no_event() -> None:
    camera = CameraModel.from_focal(100, 100, 90.0, mask=masked(0.3))
    watch = MaskWatch(camera)
    assert watch.share == 0.3
    assert watch.step(0, 0) == []
