"""Frames out of video files and image folders, whole and damaged."""

import cv2
import folder_edits
import numpy as np
import pytest
from flight_copy import FLIGHTS

from drivers.errors import DriverError
from drivers.files.video_file import ImageFolder, VideoFile, open_pictures
from drivers.samples import Frame, Refusal

RECORDED = FLIGHTS / "stairs_c" / "camera.mkv"


def pictures(count, size=(96, 64)):
    """Grey pictures that are all different."""
    width, height = size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    return [((x * 2 + y + 7 * k) % 200 + 20).astype(np.uint8) for k in range(count)]


def write_video(path, images, fourcc, fps=25.0):
    height, width = images[0].shape
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*fourcc), fps, (width, height), True
    )
    assert writer.isOpened()
    for image in images:
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR))
    writer.release()
    return path


@pytest.mark.parametrize(("name", "fourcc"), [("a.mkv", "FFV1"), ("a.avi", "MJPG"), ("a.mp4", "mp4v")])
def test_every_codec_gives_the_grey_picture(tmp_path, name, fourcc):
    images = pictures(12)
    video = VideoFile(write_video(tmp_path / name, images, fourcc))
    assert (video.width, video.height, video.fps) == (96, 64, 25.0)
    got = list(video.images())
    assert [index for index, _ in got] == list(range(12))
    for image, (_, read) in zip(images, got, strict=True):
        assert read.shape == (64, 96)
        assert read.dtype == np.uint8
        # Luma of a limited range is squeezed by 219/255; what counts is that it is the same picture.
        assert np.corrcoef(image.ravel(), read.ravel())[0, 1] > 0.98


def test_luma_is_the_picture_that_conversion_gives():
    (_, luma) = next(VideoFile(RECORDED).images())
    colour = cv2.VideoCapture(str(RECORDED)).read()[1]
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(float)
    stretched = np.clip((luma.astype(float) - 16) * 255 / 219, 0, 255)
    assert np.abs(stretched - grey).mean() < 2


def test_images_stay_as_they_were_when_the_next_one_is_read():
    frames = VideoFile(RECORDED).images()
    _, first = next(frames)
    copy = first.copy()
    next(frames)
    assert np.array_equal(first, copy)


def test_stamps_follow_the_frame_rate(tmp_path):
    video = VideoFile(write_video(tmp_path / "a.avi", pictures(5), "MJPG"))
    assert [f.stamp_us for f in video.frames(start_us=1000)] == [1000 + 40_000 * k for k in range(5)]
    assert [f.stamp_us for f in video.frames(fps=10)] == [100_000 * k for k in range(5)], "played slower"


def test_a_cut_video_is_read_to_the_cut(tmp_path):
    data = RECORDED.read_bytes()
    path = tmp_path / "cut.mkv"
    path.write_bytes(data[: len(data) // 3])
    samples = list(VideoFile(path).frames())
    frames = [s for s in samples if isinstance(s, Frame)]
    assert 100 < len(frames) < 400
    assert [f.number for f in frames[:100]] == list(range(100))
    assert [s.reason for s in samples if isinstance(s, Refusal)][-1] == "undecodable_frame"


def test_frames_behind_damage_keep_their_time(tmp_path):
    recorded = FLIGHTS / "stairs_a" / "camera.mkv"
    path = tmp_path / "damaged.mkv"
    path.write_bytes(folder_edits.damaged(recorded.read_bytes()))
    samples = list(VideoFile(path).frames())
    frames = [s for s in samples if isinstance(s, Frame)]
    (lost,) = [s for s in samples if isinstance(s, Refusal)]
    assert lost.reason == "undecodable_frame"
    assert 654 < len(frames) < 754
    assert frames[-1].stamp_us == pytest.approx(753 / 30 * 1e6, abs=2000)
    assert frames[-1].number == len(frames) - 1


@pytest.mark.parametrize(
    ("content", "words"), [(None, "no such"), (b"", "empty"), (b"no video at all" * 200, "no video")]
)
def test_what_is_no_video_is_named(tmp_path, content, words):
    path = tmp_path / "a.mkv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(DriverError, match=rf"a\.mkv.*{words}"):
        VideoFile(path)


def test_image_folder_in_the_order_of_numbers(tmp_path):
    images = pictures(12)
    for k, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"frame{k}.png"), image)
    (tmp_path / "notes.txt").write_text("not an image")
    folder = open_pictures(tmp_path)
    assert isinstance(folder, ImageFolder)
    frames = list(folder.frames(fps=20))
    assert [f.stamp_us for f in frames] == [50_000 * k for k in range(12)]
    assert all(np.array_equal(f.image, image) for f, image in zip(frames, images, strict=True))


def test_images_that_do_not_fit_are_refused(tmp_path):
    for k, image in enumerate(pictures(4)):
        cv2.imwrite(str(tmp_path / f"{k}.png"), image)
    (tmp_path / "1.png").write_bytes(b"broken")
    cv2.imwrite(str(tmp_path / "2.png"), pictures(1, (32, 32))[0])
    got = list(ImageFolder(tmp_path).frames())
    assert [s.reason if isinstance(s, Refusal) else s.number for s in got] == [
        0,
        "undecodable_frame",
        "image_size",
        3,
    ]


def test_folders_without_images_are_named(tmp_path):
    with pytest.raises(DriverError, match="no images"):
        ImageFolder(tmp_path)
    (tmp_path / "a.png").write_bytes(b"broken")
    with pytest.raises(DriverError, match="none of its 1 images"):
        ImageFolder(tmp_path)
    with pytest.raises(DriverError, match="no such file or folder"):
        open_pictures(tmp_path / "nowhere")
