"""Threads that may hang inside of a library: the process ends past them."""

import logging
import os
import sys
import threading
import time


class HangingThread(threading.Thread):
    """A daemon thread that waits in foreign code which nobody can interrupt: a device, a router that is silent."""

    def __init__(self, **given: object) -> None:
        super().__init__(daemon=True, **given)  # type: ignore[arg-type]


def end_past_hanging_threads(code: int, patience_s: float = 0.3) -> None:
    """End the process at once, with ``code``, if such a thread still runs; else do nothing.

    The interpreter's own way out would stop it inside of foreign code, which aborts. To be called last of all.
    """
    until = time.monotonic() + patience_s
    for thread in threading.enumerate():
        if isinstance(thread, HangingThread):
            thread.join(max(0.0, until - time.monotonic()))
            if thread.is_alive():
                logging.shutdown()
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
