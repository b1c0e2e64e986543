"""Takes over and flies north until it is killed: the part of the daemon that sends setpoints, as a process.

Usage: offboard_flight.py CONNECTION MODE, MODE being the flight mode that it takes over in.
"""

import sys
import time

from drivers.autopilot.autopilot import Autopilot
from drivers.mavlink.link import Link, LinkOptions


def main() -> None:
    """Fly."""
    link = Link(LinkOptions(sys.argv[1], 1, rates_hz={"CURRENT_MODE": 20.0}), lambda samples: None)
    autopilot = Autopilot(link)
    link.start()
    while not autopilot.connect(0.5):
        time.sleep(0.05)
    assert autopilot.offboard is not None
    print(autopilot.offboard.start(sys.argv[2], 0.0, 2.0, 1.0))
    while autopilot.offboard.velocity((0.6, 0.0, 0.0)):
        time.sleep(0.03)


if __name__ == "__main__":
    main()
