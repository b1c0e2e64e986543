"""Coverage of a live calibration as a web page that renews itself, for a board without a screen."""

import html
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Self

from companion.calibration.calibration import COVERAGE_COLUMNS
from companion.errors import LandslopeError

RENEW_S = 1
TIMEOUT_S = 5.0
"""A reader that sends nothing for so long is let go."""
_PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><title>calibrating</title>
<meta http-equiv="refresh" content="{renew}"><meta name="viewport" content="width=device-width">
<style>body{{font:1.2em sans-serif;margin:1em}} table{{border-collapse:collapse;width:min(96vw,40em)}}
td{{border:1px solid #888;aspect-ratio:1;width:{width:.2f}%}} .seen{{background:#2a7f3f}}</style></head>
<body><h1>Calibrating the camera</h1><table aria-label="parts of the picture where the board was seen">
{rows}</table><p>{words}</p></body></html>
"""


def page_of(drawn: str) -> str:
    """The page of ``LiveCalibration.drawn()``: rows of # and ., then words."""
    lines = drawn.splitlines()
    grid = [line for line in lines if line and not line.strip("#.")]
    words = " ".join(line for line in lines if line not in grid)
    rows = "\n".join(
        "<tr>"
        + "".join(f'<td class="seen">{"&#x2713;"}</td>' if c == "#" else "<td></td>" for c in row)
        + "</tr>"
        for row in grid
    )
    return _PAGE.format(renew=RENEW_S, width=100 / COVERAGE_COLUMNS, rows=rows, words=html.escape(words))


def address_of(text: str) -> tuple[str, int]:
    """Host and port of "8080" (this machine alone) or "0.0.0.0:8080". Raises LandslopeError for anything else."""
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdigit() and 0 <= int(port) <= 65_535):
        raise LandslopeError(f"--page {text}: write a port, as 8080, or host and port, as 0.0.0.0:8080")
    return host.strip("[]") or "127.0.0.1", int(port)


class CoveragePage:
    """Serves the newest state while a ``with`` block lasts."""

    def __init__(self, host: str, port: int) -> None:
        self._page = page_of("waiting for the camera").encode()
        served = self

        class Handler(BaseHTTPRequestHandler):
            timeout = TIMEOUT_S

            def do_GET(self) -> None:
                if self.path != "/":
                    self.send_error(404)
                    return
                self.send_response(200)
                self.send_header("Content-Type", "text/html; charset=utf-8")
                self.send_header("Content-Length", str(len(served._page)))
                self.send_header("Cache-Control", "no-store")
                self.end_headers()
                self.wfile.write(served._page)

            def log_message(self, *args: object) -> None:
                """Nothing: the terminal shows the coverage."""

        try:
            self._server = ThreadingHTTPServer((host, port), Handler)
        except OSError as error:
            raise LandslopeError(f"--page {host}:{port}: cannot be served: {error.strerror}") from None
        self._server.daemon_threads = True
        self.port = int(self._server.server_address[1])
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)

    def show(self, drawn: str) -> None:
        """What the page shows from now on."""
        self._page = page_of(drawn).encode()

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._server.server_close()
