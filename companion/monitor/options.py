"""Options of the monitor's command line."""

import ipaddress
from dataclasses import dataclass
from typing import Annotated

from landing.options import Limits

SHORTEST_TOKEN = 12


@dataclass(frozen=True, slots=True)
class MonitorOptions:
    """Bounds and rates of the page."""

    silent_after_s: Annotated[
        float,
        Limits(1.5, 60, "s", "a vehicle that said nothing for longer is silent; health comes every second"),
    ] = 3.0
    refresh_hz: Annotated[float, Limits(0.5, 20, "Hz", "updates of the page a second")] = 10.0
    history_s: Annotated[float, Limits(60, 3600, "s", "how far one can look back")] = 600.0
    chart_s: Annotated[float, Limits(5, 600, "s", "what the charts show at once")] = 60.0
    history_hz: Annotated[float, Limits(0.5, 10, "Hz", "most points a second that the charts keep")] = 2.0
    max_vehicles: Annotated[
        int, Limits(1, 1000, "", "vehicles kept; further ones are counted and left out")
    ] = 200
    max_events: Annotated[int, Limits(1, 1000, "", "events kept of each vehicle")] = 30
    max_message_bytes: Annotated[int, Limits(1000, 10_000_000, "B", "larger messages are refused")] = (
        1_000_000
    )


def is_loopback(host: str) -> bool:
    """Whether only programs on this machine reach that address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
