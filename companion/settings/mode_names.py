"""Flight modes in the settings: any ground station's spelling, checked against those that autopilots have."""

from collections.abc import Callable

from landing.decision.permission import AUTOMATIC_MODES

ENABLE_MODES = "landing.enable_modes"
MODE_SETTINGS = frozenset({ENABLE_MODES, "landing.allowed_modes"})


def flight_modes(
    path: str, names: tuple[str, ...], nearest: Callable[[str, list[str]], str]
) -> tuple[str, ...]:
    """The modes by the names that heartbeats are read by.

    ``nearest`` suggests, in words, what may have been meant. ValueError for a mode that no autopilot has, and for an
    enabling mode that the autopilot enters by itself.
    """
    from drivers.mavlink.flight_modes import (  # pymavlink, for those who name modes
        canonical_mode,
        known_modes,
    )

    found = []
    for name in names:
        mode = canonical_mode(name)
        if mode is None:
            near = nearest(name.upper(), sorted(known_modes()))
            raise ValueError(f"{path}: '{name}' is no flight mode of ArduPilot or PX4{near}")
        if path == ENABLE_MODES and mode in AUTOMATIC_MODES:
            raise ValueError(
                f"{path}: {mode} is a mode that the autopilot enters by itself, so it enables nothing; "
                "name one that the pilot chooses"
            )
        found.append(mode)
    return tuple(found)
