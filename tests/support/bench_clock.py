"""The time of a bench: camera, autopilot and daemon live by it, and it waits for whoever is behind.

A busy machine makes the flight longer, and nothing else: no message is late and no frame is skipped because a thread
got no processor.
"""

import math
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack

from drivers.system import host_clock

SPEED = 3.0
"""Faster than a real flight; who is behind is waited for."""
STEP_S = 0.001
MOST_S = 0.02
"""The clock moves on by no more at once, however long nobody looked at it."""
SLACK_US = 4000
"""How far it may be beyond what somebody still has to do: messages and frames of real devices vary by as much."""
HELD_S = 0.5
"""It waits no longer for anybody: a pipeline that hangs is the test's own doing."""


class BenchClock:
    """``hold`` are asked whether somebody is behind; ``limit`` names the moment of a thread's next deed.

    Before ``start`` it goes as the machine's own. With ``driven`` false it is never anything else, and nobody is
    waited for.
    """

    def __init__(self, *, driven: bool = True, speed: float = SPEED) -> None:
        self.started = threading.Event()
        self.over = False
        self.hold: list[Callable[[], bool]] = []
        self.last_us = -1
        self._driven, self._speed = driven, speed
        self._us = host_clock.now_us()
        self._start_us = 0
        self._limits: dict[str, float] = {}
        self._moved = threading.Condition()
        self._stop = threading.Event()
        self._stack = ExitStack()
        self._thread = threading.Thread(target=self._run, name="bench clock", daemon=True)

    def __enter__(self) -> "BenchClock":
        if self._driven:
            self._stack.enter_context(host_clock.driven(lambda: self._us))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._stack.close()

    def start(self) -> None:
        """The flight begins now."""
        with self._moved:
            self._start_us = self._us
        self.started.set()

    def monotonic(self) -> float:
        """In place of ``time.monotonic``, s."""
        return self._us * 1e-6

    def seconds(self) -> float:
        """Into the flight; -1 before it begins."""
        return (self._us - self._start_us) * 1e-6 if self.started.is_set() else -1.0

    def host_us(self, t_us: int) -> int:
        """The companion's clock at a moment of the flight."""
        return self._start_us + t_us

    def limit(self, who: str, t_us: float) -> None:
        """The clock does not pass ``t_us`` of the flight until ``who`` names a later moment."""
        self._limits[who] = t_us

    def wait_until(self, t_us: float) -> None:
        """Until a moment of the flight has come; returns early once the bench is closed."""
        self.started.wait()
        with self._moved:
            self._moved.wait_for(lambda: self._us >= self._start_us + t_us or self._stop.is_set())

    def _run(self) -> None:
        before_s = moved_s = time.monotonic()
        while not self._stop.wait(STEP_S):
            now_s = time.monotonic()
            speed = self._speed if self.started.is_set() else 1.0
            us = self._us + round(min(now_s - before_s, MOST_S) * speed * 1e6)
            before_s = now_s
            if not self._driven:
                us = host_clock.now_us()
            elif self.started.is_set() and now_s - moved_s < HELD_S:
                if any(behind() for behind in self.hold):
                    continue
                furthest = min(self._limits.values(), default=math.inf)
                us = min(us, self._start_us + furthest + SLACK_US)
            if us > self._us:
                moved_s = now_s
                with self._moved:
                    self._us = int(us)
                    self._moved.notify_all()
        with self._moved:
            self._moved.notify_all()
