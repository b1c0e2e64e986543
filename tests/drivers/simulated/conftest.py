"""A simulated autopilot with a ground station that talks to it."""

from collections.abc import Callable, Iterator

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulated_autopilot_support import Station

from drivers.simulated.vehicle.autopilot import SimulatedAutopilot
from drivers.simulated.vehicle.vehicle import Multirotor


@pytest.fixture
def station() -> Iterator[Callable[..., Station]]:
    """Makes stations that talk with an autopilot hovering 3 m up in GUIDED."""
    stations: list[Station] = []

    def make(airborne: bool = True, **options: object) -> Station:
        vehicle = Multirotor()
        if airborne:
            vehicle.place(0.0, 0.0, height=3.0)
        autopilot = SimulatedAutopilot("udpin:127.0.0.1:0", vehicle, **options)
        if airborne:
            autopilot.controller.start_airborne()
        stations.append(Station(autopilot))
        stations[-1].send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3))
        stations[-1].run(0.05)
        return stations[-1]

    yield make
    for each in stations:
        each.close()
