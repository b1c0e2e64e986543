"""V4L2 and Raspberry Pi cameras, with stand-ins for the device and the library."""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
from camera_support import textured

from companion.doctor.camera import CameraExamination
from companion.doctor.findings import DoctorOptions
from companion.settings.settings import CameraSettings, Settings
from drivers.cameras import CameraFormat, picamera
from drivers.cameras.picamera import PicameraGrabber
from drivers.cameras.v4l2 import V4l2Grabber
from drivers.errors import DriverError
from drivers.system.host_clock import from_monotonic_us, now_us


class FakeV4l2:
    """cv2.VideoCapture's way with a V4L2 device: properties, kernel stamps, buffers."""

    def __init__(self, clock_us, fixed_size=(160, 120), alive=10) -> None:
        self.clock_us, self.alive = clock_us, alive
        self.props = {cv2.CAP_PROP_FRAME_WIDTH: fixed_size[0], cv2.CAP_PROP_FRAME_HEIGHT: fixed_size[1]}
        self.sizes, self.released, self.stamp_us, self.count = (fixed_size,), False, 0, 0

    def isOpened(self) -> bool:
        return True

    def set(self, prop, value) -> bool:
        if prop not in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT):
            self.props[prop] = value
        return True

    def get(self, prop) -> float:
        return self.stamp_us / 1000 if prop == cv2.CAP_PROP_POS_MSEC else self.props.get(prop, -1.0)

    def grab(self) -> bool:
        self.count += 1
        self.stamp_us = self.clock_us() - 7000
        return self.count <= self.alive

    def retrieve(self):
        yuyv = np.dstack([textured(self.count), np.full((120, 160), 128, np.uint8)])
        return True, yuyv

    def release(self) -> None:
        self.released = True


def v4l2(monkeypatch, tmp_path, device: FakeV4l2, wanted: CameraFormat) -> V4l2Grabber:
    path = tmp_path / "video0"
    path.touch()
    monkeypatch.setattr(cv2, "VideoCapture", lambda *args: device)
    return V4l2Grabber(str(path), wanted)


def test_v4l2_takes_the_kernels_stamp_and_fixes_exposure_gain_and_format(monkeypatch, tmp_path):
    device = FakeV4l2(lambda: time.monotonic_ns() // 1000)
    wanted = CameraFormat(160, 120, 30, exposure_us=2000, gain=16, pixel_format="YUYV")
    grabber = v4l2(monkeypatch, tmp_path, device, wanted)
    grabber.open()
    grab = grabber.grab()
    assert grab.captured_us == from_monotonic_us(device.stamp_us)
    assert np.array_equal(grab.image, textured(1))
    assert device.props[cv2.CAP_PROP_AUTO_EXPOSURE] == 1
    assert device.props[cv2.CAP_PROP_EXPOSURE] == 20
    assert device.props[cv2.CAP_PROP_GAIN] == 16
    assert device.props[cv2.CAP_PROP_FPS] == 30
    assert device.props[cv2.CAP_PROP_CONVERT_RGB] == 0
    for _ in range(device.alive - 1):
        grabber.grab()
    with pytest.raises(DriverError, match="unplugged"):
        grabber.grab()
    grabber.close()
    assert device.released


def test_v4l2_stamps_of_another_clock_give_way_to_the_arrival(monkeypatch, tmp_path, caplog):
    device = FakeV4l2(lambda: time.time_ns() // 1000)
    grabber = v4l2(monkeypatch, tmp_path, device, CameraFormat(pixel_format="YUYV"))
    grabber.open()
    stamps = [grabber.grab().captured_us for _ in range(3)]
    assert all(abs(now_us() - stamp) < 1_000_000 for stamp in stamps)
    assert caplog.text.count("monotonic clock") == 1


def test_v4l2_size_that_the_device_does_not_have_is_refused(monkeypatch, tmp_path):
    device = FakeV4l2(lambda: time.monotonic_ns() // 1000)
    grabber = v4l2(monkeypatch, tmp_path, device, CameraFormat(640, 480))
    with pytest.raises(DriverError, match="gives 160 x 120, not the 640 x 480"):
        grabber.open()


PICAMERA2 = """
import sys, time
import numpy as np

print("libcamera speaks on standard output, as it does")

class Picamera2:
    def __init__(self, number):
        if number > 0:
            raise IndexError("list index out of range")
    def create_video_configuration(self, **configuration):
        return configuration
    def configure(self, configuration):
        c = configuration["controls"]
        assert configuration["main"]["format"] == "YUV420"
        self.requested = (c["FrameDurationLimits"][0], c.get("ExposureTime", 0), c.get("AnalogueGain", -1))
        self.width, self.height = configuration["main"]["size"]
    def start(self):
        self.frames = 0
    def capture_request(self):
        time.sleep(0.02)
        self.frames += 1
        if self.frames > 30:
            raise RuntimeError("the camera is gone")
        self.stamp_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME) - 12_000_000
        return self
    def make_array(self, name):
        picture = np.full((self.height * 3 // 2, self.width + 32), 60, np.uint8)
        picture[0, :3] = [max(0, n) // m for n, m in zip(self.requested, (1000, 100, 1))]
        picture[:, self.width:] = 255
        return picture
    def get_metadata(self):
        return {"SensorTimestamp": self.stamp_ns}
    def release(self):
        pass
"""
"""picamera2's way with a sensor: a configuration, then completed requests of padded YUV 4:2:0."""


def system_python(directory: Path, monkeypatch, files: dict[str, str]) -> None:
    """A system whose python3 finds a picamera2 of these files, laid out as Debian does, and ours does not."""
    packages = directory / "lib" / "python3" / "dist-packages"
    (packages / "picamera2").mkdir(parents=True)
    for name, text in files.items():
        (packages / "picamera2" / name).write_text(text)
    code = (
        "import runpy, sys; del sys.argv[0]; assert sys.argv.pop(0) == '-I'; "
        f"sys.path.insert(0, {str(packages)!r}); runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    python = directory / "python3"
    python.write_text(f'#!/bin/sh\nexec "{sys.executable}" -c "{code}" "$@"\n')
    python.chmod(0o755)
    monkeypatch.setattr(picamera, "SYSTEM_PYTHON", python)


@pytest.fixture
def picamera2(tmp_path, monkeypatch):
    files = {"__init__.py": "from .picamera2 import Picamera2\n", "picamera2.py": PICAMERA2}
    system_python(tmp_path, monkeypatch, files)


def test_picamera_is_fixed_and_stamped_by_the_sensor(picamera2):
    grabber = PicameraGrabber(0, CameraFormat(160, 120, 50, exposure_us=3000, gain=2.0))
    grabber.open()
    process = grabber._process
    grabs = [grabber.grab() for _ in range(4)]
    assert all(g.image.shape == (120, 160) for g in grabs)
    assert grabs[0].image[0, :3].tolist() == [20, 30, 2], "20 ms a frame, 3 ms of exposure, gain 2"
    assert (grabs[3].image[1:] == 60).all(), "the padding is cut off"
    times = [g.captured_us for g in grabs]
    assert times == sorted(set(times))
    assert 0 < now_us() - times[3] < 5_000_000
    grabber.close()
    assert process.returncode is not None


def grab_many(grabber: PicameraGrabber) -> None:
    for _ in range(100):
        grabber.grab()


def test_picamera_that_goes_away_is_an_error_and_can_be_opened_again(picamera2):
    grabber = PicameraGrabber(0, CameraFormat(160, 120, 50))
    for _ in range(2):
        grabber.open()
        with pytest.raises(DriverError, match="the camera is gone"):
            grab_many(grabber)
        grabber.close()


def test_a_process_that_dies_is_an_error(picamera2):
    grabber = PicameraGrabber(0, CameraFormat(160, 120, 50))
    grabber.open()
    grabber._process.kill()
    with pytest.raises(DriverError, match="its process ended"):
        grab_many(grabber)
    grabber.close()


def test_picamera_that_is_not_there(picamera2):
    with pytest.raises(DriverError, match=r"Raspberry Pi camera 1: .*cable"):
        PicameraGrabber(1, CameraFormat()).open()


def test_picamera_without_the_library_or_the_systems_python_says_what_to_install(tmp_path, monkeypatch):
    with pytest.raises(DriverError, match="python3-picamera2"):
        PicameraGrabber(0, CameraFormat()).open()
    monkeypatch.setattr(picamera, "SYSTEM_PYTHON", tmp_path / "python3")
    with pytest.raises(DriverError, match="apt install python3"):
        PicameraGrabber(0, CameraFormat()).open()


STAND_INS = {
    "numpy.dtype size changed": (
        'raise ValueError("numpy.dtype size changed, may indicate binary incompatibility. Expected 96 from C '
        'header, got 88 from PyObject")',
        "another numpy",
    ),
    "numpy 2": ('raise AttributeError("_ARRAY_API not found")', "another numpy"),
    "multiarray": ('raise ImportError("numpy.core.multiarray failed to import")', "another numpy"),
    "libcamera": ("import libcamera", "python3-libcamera"),
    "kms": ("import pykms.card", "python3-pykms"),
    "odd": ("raise SystemError('initialization failed')", "reinstall python3-picamera2"),
}
"""How the real package fails to import, as its own modules would, and what the message must name."""


@pytest.mark.parametrize("fault", STAND_INS)
def test_picamera2_that_cannot_be_imported_says_why_in_one_sentence(tmp_path, monkeypatch, fault):
    statement, named = STAND_INS[fault]
    text = f"{statement}\n\nclass Picamera2: pass\n"
    files = {"__init__.py": "from .picamera2 import Picamera2\n", "picamera2.py": text}
    system_python(tmp_path, monkeypatch, files)
    with pytest.raises(DriverError, match=named) as refusal:
        PicameraGrabber(0, CameraFormat()).open()
    assert "\n" not in str(refusal.value)
    assert "cable" not in str(refusal.value)
    assert refusal.value.remedy


def test_doctor_names_the_package_and_not_the_cable(tmp_path, monkeypatch):
    system_python(tmp_path, monkeypatch, {"__init__.py": STAND_INS["numpy.dtype size changed"][0] + "\n"})
    settings = Settings(camera=CameraSettings(source="picamera"))
    examination = CameraExamination(settings, DoctorOptions())
    until = time.monotonic() + 300
    while not examination._camera.status().problem and time.monotonic() < until:
        examination.look(0.05)
    (finding,) = examination.findings()
    examination.close()
    assert finding.level == "failure"
    assert "numpy" in finding.text
    assert "cable" not in finding.remedy
