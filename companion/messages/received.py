"""What comes from a vehicle is believed no further than its schema: validated, bounded, printable."""

from collections.abc import Mapping

import msgspec

from companion.messages.ground import Ground
from companion.messages.ground_cells import cells_of
from companion.messages.messages import Decision, Estimate, Event, Health
from companion.messages.preview import Preview

MAX_BYTES = 262_144
"""Longest message that is looked at."""

LATEST_US = 4_102_444_800_000_000
"""The year 2100: a later time is nonsense, and beyond what the formats can hold."""
LARGEST_FRAME = 2**53
LARGEST_IMAGE_PX = 100_000
LONGEST_TEXT = 400
FARTHEST_M = 1e6
LARGEST_CELL_M = 100.0
MOST_SPOTS = 100

Received = Estimate | Ground | Decision | Health | Event | Preview

_DECODERS: Mapping[str, msgspec.json.Decoder[Received]] = {
    "estimate": msgspec.json.Decoder(Estimate),
    "ground": msgspec.json.Decoder(Ground),
    "decision": msgspec.json.Decoder(Decision),
    "health": msgspec.json.Decoder(Health),
    "event": msgspec.json.Decoder(Event),
    "preview": msgspec.json.Decoder(Preview),
}


def received(topic: str, raw: bytes, max_bytes: int = MAX_BYTES) -> Received | None:
    """The message of a topic; None when it does not follow the schema or its numbers cannot be true."""
    decoder = _DECODERS.get(topic)
    if decoder is None or len(raw) > max_bytes:
        return None
    try:
        found = decoder.decode(raw)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
    return found if _is_plausible(found) else None


def printable(text: str) -> str:
    """A text of a vehicle for a terminal: no control characters, no escape sequences, not without end."""
    clean = "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text
    )
    return clean if len(clean) <= LONGEST_TEXT else clean[:LONGEST_TEXT] + "…"


def _is_plausible(message: Received) -> bool:
    """Whether its numbers are ones that can be shown."""
    if not 0 <= message.time_unix_us <= LATEST_US:
        return False
    if isinstance(message, Ground):
        return 0 <= message.frame <= LARGEST_FRAME and _is_drawable(message)
    if isinstance(message, Preview):
        return 0 < message.width <= LARGEST_IMAGE_PX and 0 < message.height <= LARGEST_IMAGE_PX
    return not isinstance(message, Estimate | Decision) or 0 <= message.frame <= LARGEST_FRAME


def _is_drawable(ground: Ground) -> bool:
    """Whether its places are on this planet, and its map has the cells that it says."""
    places = [ground.north_m, ground.east_m, ground.down_m]
    places += [part for part in (ground.touchdown.north_m, ground.touchdown.east_m) if part is not None]
    places += [part for spot in ground.spots for part in (spot.north_m, spot.east_m, spot.radius_m)]
    grid = ground.map
    if grid is not None:
        if not 0 < grid.cell_m <= LARGEST_CELL_M or cells_of({"map": msgspec.to_builtins(grid)}) is None:
            return False
        places += [grid.north0_m, grid.east0_m]
    return len(ground.spots) <= MOST_SPOTS and all(abs(part) <= FARTHEST_M for part in places)
