"""Pictures that a camera sends as JPEG: their luma alone, and nothing where they are broken."""

import cv2
import numpy as np
import pytest
from camera_support import MjpegServer, moving, textured

from drivers.cameras import ReaderLimits, open_camera
from drivers.cameras.grey import grey_of, grey_of_jpeg
from drivers.samples import Frame


def test_grey_of_a_jpeg_is_its_luma():
    # a coarse scene in full colour: what is compared is the way, not the compression
    coarse = np.random.default_rng(2).integers(0, 256, (6, 8, 3), np.uint8)
    colour = cv2.resize(coarse, (160, 120), interpolation=cv2.INTER_CUBIC)
    jpeg = cv2.imencode(".jpg", colour, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
    grey = grey_of_jpeg(jpeg)
    assert grey is not None
    through_colour = grey_of(cv2.imdecode(jpeg, cv2.IMREAD_COLOR))
    assert np.abs(grey.astype(int) - through_colour).max() <= 4
    padded = np.concatenate([jpeg.ravel(), np.zeros(2000, np.uint8)])[None]
    assert np.array_equal(grey_of_jpeg(padded), grey)


@pytest.mark.parametrize("kept", [0, 1, 2, 500, -1])
def test_a_broken_jpeg_is_no_picture(kept: int):
    jpeg = cv2.imencode(".jpg", textured(0))[1].ravel()
    assert grey_of_jpeg(jpeg[:kept]) is None


def test_a_stream_goes_on_behind_broken_jpegs():
    limits = ReaderLimits(open_timeout_s=20.0)
    with MjpegServer(moving(), cut={3, 4, 8}) as server, open_camera(server.url, limits=limits) as camera:
        while camera.status().grabbed < 12:
            for frame in camera.read(0.2):
                assert isinstance(frame, Frame)
                assert min(frame.image[-20:].std(), frame.image[:20].std()) > 5, "no half of it was made up"
