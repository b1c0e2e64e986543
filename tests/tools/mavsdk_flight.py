"""Takeoff, goto and land with MAVSDK's own calls: a script that knows nothing of landslope.

Usage: mavsdk_flight.py CONNECTION_URL. Prints what it did, one line a step, as JSON.
"""

import json
import math
import sys
import time
from collections.abc import Callable

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.action import Action
from mavsdk.plugins.telemetry import Telemetry


def wait_for(condition: Callable[[], bool], what: str, seconds: float = 300.0) -> None:
    """Poll until the condition holds; end the script when it does not."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"gave up waiting for {what}")
        time.sleep(0.05)


def main() -> None:
    """Fly."""
    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(sys.argv[1])
    system = sdk.first_autopilot(10.0)
    if system is None:
        sys.exit("no autopilot")
    action, telemetry = Action(system), Telemetry(system)
    wait_for(lambda: telemetry.health().is_armable, "the vehicle to be ready")
    wait_for(lambda: abs(telemetry.position().latitude_deg) > 1, "a position")
    start = telemetry.position()
    action.arm()
    wait_for(telemetry.armed, "the motors")
    print(json.dumps({"armed": telemetry.armed()}))
    action.set_takeoff_altitude(4.0)
    action.takeoff()
    wait_for(lambda: telemetry.position().relative_altitude_m > 3.7, "the climb")
    print(json.dumps({"height_m": telemetry.position().relative_altitude_m, "in_air": telemetry.in_air()}))
    north_m = 12.0
    latitude = start.latitude_deg + math.degrees(north_m / 6378137.0)
    action.goto_location(latitude, start.longitude_deg, start.absolute_altitude_m + 6.0, 90.0)
    wait_for(
        lambda: (
            abs(telemetry.position().latitude_deg - latitude) < 5e-6
            and abs(telemetry.position().relative_altitude_m - 6.0) < 0.3
        ),
        "the place to go to",
    )
    there = telemetry.position()
    print(json.dumps({"north_m": math.radians(there.latitude_deg - start.latitude_deg) * 6378137.0}))
    print(json.dumps({"yaw_deg": telemetry.attitude_euler().yaw_deg, "height_m": there.relative_altitude_m}))
    action.land()
    wait_for(lambda: not telemetry.armed(), "the landing")
    print(
        json.dumps(
            {"landed_height_m": telemetry.position().relative_altitude_m, "in_air": telemetry.in_air()}
        )
    )

    sdk.destroy()


if __name__ == "__main__":
    main()
