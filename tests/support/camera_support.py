"""Cameras to test against: an MJPEG server, an RTSP server, and frames with texture."""

import socket
import socketserver
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from places import REPOSITORY

SITL_LOGS = REPOSITORY / "sitl_logs"


def textured(number: int, width: int = 160, height: int = 120) -> NDArray[np.uint8]:
    """A picture that differs from number to number: blurred noise that moves by three pixels a frame."""
    noise = np.random.default_rng(5).random((height, width)).astype(np.float32)
    smooth = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 2), None, 0, 255, cv2.NORM_MINMAX)
    return np.roll(smooth, 3 * number, axis=1).astype(np.uint8)


class MjpegServer:
    """HTTP server whose one page is a stream of JPEGs; ``pause`` makes it fall silent, ``drop`` cuts the line."""

    def __init__(
        self,
        frames: Iterable[NDArray[np.uint8]],
        rate_hz: float = 30.0,
        port: int = 0,
        cut: frozenset[int] | set[int] = frozenset(),
    ) -> None:
        """``cut``: numbers of the frames of which only the first half is sent, as a complete part."""
        self._cut = cut
        self.rate_hz = rate_hz
        self.pause = threading.Event()
        self.drop = threading.Event()
        self._stop = threading.Event()
        self._source = iter(frames)
        outer = self

        class Page(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.drop.clear()
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
                self.end_headers()
                try:
                    outer._send(self.wfile)
                except OSError:
                    return

            def log_message(self, *args: object) -> None:
                return

        ThreadingHTTPServer.allow_reuse_address = True
        self._server = ThreadingHTTPServer(("127.0.0.1", port), Page)
        self._server.daemon_threads = True
        self.port = self._server.server_address[1]
        self.url = f"http://127.0.0.1:{self.port}/stream.mjpg"
        threading.Thread(
            target=self._server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        ).start()

    def _send(self, out) -> None:
        due = time.monotonic()
        for number, image in enumerate(self._source):
            while self.pause.is_set() and not self._stop.is_set():
                time.sleep(0.02)
            if self._stop.is_set() or self.drop.is_set():
                return
            jpeg = cv2.imencode(".jpg", image)[1].tobytes()
            jpeg = jpeg[: len(jpeg) // 2] if number in self._cut else jpeg
            out.write(
                b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg)
                + jpeg
                + b"\r\n"
            )
            out.flush()
            due += 1 / self.rate_hz
            time.sleep(max(0.0, due - time.monotonic()))

    def close(self) -> None:
        """Stop serving."""
        self._stop.set()
        self._server.shutdown()
        self._server.server_close()

    def __enter__(self) -> "MjpegServer":
        return self

    def __exit__(self, *exc: object) -> None:
        self.close()


def moving(width: int = 160, height: int = 120) -> Iterator[NDArray[np.uint8]]:
    """Textured pictures without end."""
    number = 0
    while True:
        yield textured(number, width, height)
        number += 1


@contextmanager
def rtsp_server(video: Path) -> Iterator[str]:
    """Serve a video once over RTSP, its RTP packets interleaved in the one TCP connection; yields the address."""

    class Session(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            sender: subprocess.Popen[bytes] | None = None
            rtp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            rtp.bind(("127.0.0.1", 0))
            rtp.settimeout(5)
            to = f"rtp://127.0.0.1:{rtp.getsockname()[1]}"
            command = [
                "ffmpeg",
                "-v",
                "error",
                "-re",
                "-i",
                str(video),
                "-an",
                "-c:v",
                "copy",
                "-bsf:v",
                "h264_mp4toannexb",
            ]
            try:
                while request := self.rfile.readline().decode():
                    verb = request.split()[0]
                    headers = {}
                    while line := self.rfile.readline().decode().strip():
                        key, _, value = line.partition(":")
                        headers[key.lower()] = value.strip()
                    extra, body = "", ""
                    if verb == "OPTIONS":
                        extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
                    elif verb == "DESCRIBE":
                        body = (
                            "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=t\r\nc=IN IP4 127.0.0.1\r\nt=0 0\r\n"
                            "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\na=fmtp:96 packetization-mode=1\r\n"
                            "a=control:track1\r\n"
                        )
                        extra = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
                    elif verb == "SETUP":
                        extra = "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\nSession: 1\r\n"
                    answer = f"RTSP/1.0 200 OK\r\nCSeq: {headers.get('cseq', '0')}\r\n{extra}\r\n{body}"
                    self.wfile.write(answer.encode())
                    self.wfile.flush()
                    if verb == "PLAY":
                        sender = subprocess.Popen([*command, "-f", "rtp", to], stdout=subprocess.DEVNULL)
                        while True:
                            packet = rtp.recv(65536)
                            self.wfile.write(b"$\x00" + len(packet).to_bytes(2, "big") + packet)
                            self.wfile.flush()
            except OSError:
                return
            finally:
                if sender is not None:
                    sender.kill()
                    sender.wait()
                rtp.close()

    class Server(socketserver.ThreadingTCPServer):
        allow_reuse_address = True
        daemon_threads = True

    with Server(("127.0.0.1", 0), Session) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        yield f"rtsp://127.0.0.1:{server.server_address[1]}/live"
        server.shutdown()
