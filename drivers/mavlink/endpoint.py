"""One port kept open: a thread reads it, and reopens it with backoff whenever it breaks."""

import threading
from collections.abc import Callable

from drivers.mavlink.ports import Address, Port, PortName, open_port, parse_port

POLL_S = 0.1
CLOSE_S = 0.5
"""How long the end of the thread is waited for: a peer that does not answer holds it for CONNECT_TIMEOUT_S."""
FIRST_BACKOFF_S = 0.2
LONGEST_BACKOFF_S = 1.0
"""A port that appears is to be in use within a second."""


class Endpoint:
    """Reads ``connection`` in a thread of its own and calls ``on_bytes(data, sender)`` there.

    ``on_state(open, why)`` is called on every change. Writing to a port that is not open loses the bytes and
    counts them. Raises DriverError at once when the name is none that can be opened.
    """

    def __init__(
        self,
        connection: str,
        on_bytes: Callable[[bytes, Address], None],
        on_state: Callable[[bool, str], None] = lambda is_open, why: None,
    ) -> None:
        self.name: PortName = parse_port(connection)
        self.opened = 0
        self.bytes_in = 0
        self.bytes_out = 0
        self.bytes_lost = 0
        self._on_bytes = on_bytes
        self._on_state = on_state
        self._port: Port | None = None
        self._write_error: OSError | None = None
        self._write_lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"link {self.name}", daemon=True)

    def start(self) -> None:
        """Begin to open and read."""
        self._thread.start()

    @property
    def is_open(self) -> bool:
        """Whether the port is open now."""
        return self._port is not None

    def write(self, data: bytes) -> bool:
        """Send from any thread; False when the port is not open or breaks."""
        with self._write_lock:
            port = self._port
            if port is not None:
                try:
                    port.write(data)
                except OSError as error:
                    self._write_error = error  # the reader sees it, says so and opens the port again
                else:
                    self.bytes_out += len(data)
                    return True
            self.bytes_lost += len(data)
            return False

    def believe(self, sender: Address) -> None:
        """Send to this sender only from now on."""
        port = self._port
        if port is not None:
            port.believe(sender)

    def close(self) -> None:
        """Stop the thread, which closes the port."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(CLOSE_S)

    def _run(self) -> None:
        backoff_s = FIRST_BACKOFF_S
        last_reason = ""
        while not self._stop.is_set():
            try:
                self._port = open_port(self.name)
            except OSError as error:
                reason = f"{self.name} cannot be opened: {_text(error)}"
                if reason != last_reason:
                    self._on_state(False, reason)
                last_reason = reason
                self._stop.wait(backoff_s)
                backoff_s = min(2 * backoff_s, LONGEST_BACKOFF_S)
                continue
            self.opened += 1
            last_reason = ""
            self._on_state(True, "")
            if self._read_until_broken(self._port):
                backoff_s = FIRST_BACKOFF_S
            self._stop.wait(0 if self._stop.is_set() else backoff_s)

    def _read_until_broken(self, port: Port) -> bool:
        """Returns whether anything was read before the port broke or the stop."""
        got_some = False
        reason = "closed"
        try:
            while not self._stop.is_set():
                if self._write_error is not None:
                    raise self._write_error
                received = port.read(POLL_S)
                if received is not None:
                    got_some = True
                    self.bytes_in += len(received[0])
                    self._on_bytes(*received)
        except OSError as error:
            reason = f"{self.name} broke: {_text(error)}"
        with self._write_lock:
            self._port = None
            self._write_error = None
            port.close()
        self._on_state(False, reason)
        return got_some


def _text(error: OSError) -> str:
    return error.strerror or str(error)
