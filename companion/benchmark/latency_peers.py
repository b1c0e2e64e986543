"""What stands around a daemon that is measured: a camera stream, an autopilot's telemetry, the times they were sent."""

import socket
import threading
import time
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pymavlink.dialects.v20 import ardupilotmega as dialect

from drivers.system.host_clock import now_us

FRAME_RATE_HZ = 30.0
TELEMETRY_RATE_HZ = 100.0
STEP_PX = 2
"""How far the ground moves from frame to frame at 320 pixels across."""
LOOP_FRAMES = 90
GUIDED_ARMED = (81 | 128, 4)
_BOUNDARY = b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n"


class PictureServer:
    """A ground that passes by under the camera, as MJPEG over HTTP; remembers when each frame was sent."""

    def __init__(self, width: int, height: int, port: int = 0) -> None:
        self.sent_us: list[int] = []
        pictures = _ground(width, height)
        stop = self._stop = threading.Event()
        sent_us = self.sent_us

        class Page(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                due, number = time.monotonic(), 0
                try:
                    while not stop.is_set():
                        jpeg = pictures[number % len(pictures)]
                        sent_us.append(now_us())
                        self.wfile.write(_BOUNDARY % len(jpeg) + jpeg + b"\r\n")
                        number += 1
                        due += 1 / FRAME_RATE_HZ
                        time.sleep(max(0.0, due - time.monotonic()))
                except OSError:
                    return  # the daemon left

            def log_message(self, *args: object) -> None:
                """Nothing."""

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Page)
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,), daemon=True)

    def __enter__(self) -> "PictureServer":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._server.shutdown()
        self._server.server_close()


class Background:
    """A thread that does ``_run`` while a ``with`` block lasts; ``_stop`` ends it."""

    def __init__(self) -> None:
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        raise NotImplementedError


class Telemetry(Background):
    """An autopilot that hovers level: telemetry at the usual rates; remembers when each ATTITUDE was sent."""

    def __init__(self, port: int) -> None:
        super().__init__()
        self.sent_us: list[int] = []
        self._target = ("127.0.0.1", port)
        self._mav = dialect.MAVLink(None, 1, 1)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def __exit__(self, *error: object) -> None:
        super().__exit__(*error)
        self._socket.close()

    def _run(self) -> None:
        start = due = time.monotonic()
        number = 0
        while not self._stop.is_set():
            boot_us = round((time.monotonic() - start) * 1e6) + 1_000_000
            self._send(dialect.MAVLink_raw_imu_message(boot_us, 0, 0, -1000, 0, 0, 0, 0, 0, 0))
            self._send(dialect.MAVLink_attitude_message(boot_us // 1000, 0, 0, 0, 0, 0, 0))
            self.sent_us.append(now_us())
            if number % 4 == 0:
                self._send(dialect.MAVLink_local_position_ned_message(boot_us // 1000, 0, 0, -2, 0.5, 0, 0))
            if number % 50 == 0:
                self._send(dialect.MAVLink_extended_sys_state_message(0, 2))
            if number % 100 == 0:  # as rarely as autopilots do
                base, mode = GUIDED_ARMED
                self._send(dialect.MAVLink_heartbeat_message(2, 3, base, mode, 4, 3))
            number += 1
            due += 1 / TELEMETRY_RATE_HZ
            time.sleep(max(0.0, due - time.monotonic()))

    def _send(self, message: dialect.MAVLink_message) -> None:
        try:
            self._socket.sendto(bytes(message.pack(self._mav)), self._target)
        except OSError:
            return  # nobody listens yet
        finally:
            self._mav.seq = (self._mav.seq + 1) % 256


@lru_cache(maxsize=4)
def _ground(width: int, height: int) -> list[bytes]:
    """JPEGs of a textured ground moving by, in a loop."""
    step = max(1, round(STEP_PX * width / 320))
    random = np.random.default_rng(1)
    noise = random.random((height, step * LOOP_FRAMES), np.float32)
    grain = cv2.GaussianBlur(np.tile(noise, 3), (0, 0), 1.5 * width / 320)[
        :, step * LOOP_FRAMES : 2 * step * LOOP_FRAMES
    ]
    texture = np.tile(_scaled(np.asarray(grain, np.float32)), (1, 2 + width // (step * LOOP_FRAMES)))
    pictures = [texture[:, step * i : step * i + width] for i in range(LOOP_FRAMES)]
    return [cv2.imencode(".jpg", np.ascontiguousarray(p))[1].tobytes() for p in pictures]


def _scaled(grain: NDArray[np.float32]) -> NDArray[np.uint8]:
    low, high = float(grain.min()), float(grain.max())
    return ((grain - low) * (235 / (high - low)) + 10).astype(np.uint8)
