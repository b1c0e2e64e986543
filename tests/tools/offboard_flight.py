"""Takes over and flies north until it is ended: the part of the daemon that sends setpoints, as a process.

Usage: offboard_flight.py CONNECTION MODE, MODE being the flight mode that it takes over in. SIGTERM ends it as the
daemon ends: control is given back, the command gets its answer, then MAVSDK is closed.
"""

import signal
import sys
import threading
import time

from companion.live.commander import Commander
from drivers.mavlink.link import Link, LinkOptions


def main() -> None:
    """Fly."""
    ended = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: ended.set())
    link = Link(LinkOptions(sys.argv[1], 1, rates_hz={"CURRENT_MODE": 20.0}), lambda samples: None)
    link.start()
    commander = Commander(link, lambda samples: None)
    commander.start()
    while not commander.connected:
        time.sleep(0.05)
    commander.take_over(sys.argv[2], 0.0, 2.0, 1.0)
    while not ended.is_set():
        commander.velocity((0.6, 0.0, 0.0))
        time.sleep(0.03)
    sys.exit(0 if commander.close() else 1)


if __name__ == "__main__":
    main()
