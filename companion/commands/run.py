"""Run the daemon: live camera and autopilot in, estimates and the landing command out."""

import argparse
import logging
import os
import signal
import threading
from pathlib import Path

from companion.settings.settings_file import load
from drivers.secrets import masked

FORMAT = "%(levelname)s %(name)s: %(message)s"
PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (0, 7))
"""Level of logging -> priority of syslog."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command's arguments."""
    parser.add_argument("--config", type=Path, metavar="FILE", help="the settings, a landslope.toml")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="SECTION.KEY=VALUE",
        dest="overrides",
        help="override a setting",
    )
    parser.add_argument("--verbose", action="store_true", help="log MAVSDK's chatter too")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT; 1 when something broke that only a restart mends."""
    _log_to_stderr(logging.DEBUG if args.verbose else logging.INFO)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # until the daemon can take settings over
    loaded = load(args.config, args.overrides)
    for note in loaded.notes:
        logging.getLogger(__name__).warning("%s", note)
    settings = loaded.settings
    import cv2

    from companion.live.inputs import Inputs

    cv2.setNumThreads(1)  # as in a replay: the same rounding, and no threads that fight for the cores
    inputs = Inputs(settings)
    broken = threading.Event()

    def thread_broke(what: threading.ExceptHookArgs) -> None:
        # A daemon without one of its threads would live on half blind.
        name = what.thread.name if what.thread else "a thread"
        trace = (what.exc_type, what.exc_value or what.exc_type(), what.exc_traceback)
        logging.getLogger(__name__).critical("thread '%s' broke", name, exc_info=trace)
        broken.set()
        inputs.stop()

    threading.excepthook = thread_broke
    # The other half of the imports; camera and autopilot answer meanwhile.
    from companion.live.daemon import Daemon, stop_on_signals

    daemon = Daemon(settings, inputs, lambda: load(args.config, args.overrides).settings)
    stop_on_signals(daemon)
    daemon.run()
    return 1 if broken.is_set() or daemon.failed else 0


def _log_to_stderr(level: int) -> None:
    """Lines with the priority that journald reads, when it listens."""
    handler = logging.StreamHandler()
    handler.setFormatter(_Priority() if "JOURNAL_STREAM" in os.environ else _Masked(FORMAT))
    logging.basicConfig(level=level, handlers=[handler])


class _Masked(logging.Formatter):
    """Without the secrets that stand in URLs, tracebacks included."""

    def format(self, record: logging.LogRecord) -> str:
        return masked(super().format(record))


class _Priority(_Masked):
    """``<4>`` in front of a warning, as sd-daemon(3) says; journald strips it and sets PRIORITY."""

    def __init__(self) -> None:
        super().__init__("%(name)s: %(message)s")

    def format(self, record: logging.LogRecord) -> str:
        priority = next(p for at, p in PRIORITIES if record.levelno >= at)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())
