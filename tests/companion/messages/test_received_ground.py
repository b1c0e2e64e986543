"""Ground messages from a vehicle are believed no further than their schema."""

import base64
import math
from typing import Any

import msgspec
import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from companion.messages.ground import Ground, ground_message
from companion.messages.messages import encode
from companion.messages.received import received
from landing.ground.ground import GroundReport, MapView
from landing.ground.spots import Disc, GroundCode, Spot


def ground() -> dict[str, Any]:
    """A message with a map of two rows and three columns."""
    height = np.array(((0.1, 0.2, math.nan), (0.0, 0.1, 0.3)))
    state = np.array(((2, 1, 0), (2, 3, 1)), np.uint8)
    report = GroundReport(
        7,
        1.0,
        np.array((5.0, -2.0, -3.0)),
        Disc("landable", (), 1.0, 0.2, 0.01, 1.0),
        Disc("unknown", (GroundCode.NOT_SEEN,)),
        0.4,
        0.0,
        (Spot(0.5, 0.5, 0.5, 1.0, 0.01, 0.3),),
    )
    view = MapView(4.9, -2.1, height, state)
    return dict(msgspec.json.decode(encode(ground_message(report, 1_000_000, 1.0, view))))


def taken(message: dict[str, Any]) -> Any:
    return received("ground", msgspec.json.encode(message))


def test_a_vehicles_own_message_comes_through_whole() -> None:
    found = taken(ground())
    assert isinstance(found, Ground)
    assert msgspec.json.decode(encode(found)) == ground()


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("rows", 3),
        ("rows", -2),
        ("columns", 0),
        ("cell_m", 0.0),
        ("cell_m", 1e9),
        ("north0_m", 1e300),
        ("state", "AA=="),
        ("state", "no base64"),
        ("height", base64.b64encode(b"x" * 11).decode()),
    ],
)
def test_a_map_that_is_not_what_it_says_is_refused(part: str, value: Any) -> None:
    message = ground()
    message["map"][part] = value
    assert taken(message) is None


@pytest.mark.parametrize(
    ("part", "value"), [("north_m", 1e9), ("frame", -1), ("time_unix_us", -1), ("east_m", None)]
)
def test_numbers_that_cannot_be_true_are_refused(part: str, value: Any) -> None:
    assert taken(ground() | {part: value}) is None


def test_spots_without_end_are_refused() -> None:
    message = ground()
    message["spots"] = message["spots"] * 101
    assert taken(message) is None


@examples(25)
@given(
    st.recursive(st.none() | st.integers() | st.text(max_size=5), lambda inner: st.lists(inner, max_size=3))
)
def test_anything_in_place_of_the_map_is_refused_and_breaks_nothing(value: Any) -> None:
    found = taken(ground() | {"map": value})
    assert (found is None) == (value is not None)
