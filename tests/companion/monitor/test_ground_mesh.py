"""The ground map in 3D: the cells around the vehicle, its place in the map's axes, and what a browser draws of them."""

import base64
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from monitor_support import CHROMEDRIVER, CHROMIUM, Browser, Monitor, Vehicle, eventually, show

from companion.messages.ground_cells import NO_HEIGHT
from companion.monitor.ground_mesh import REACH_CELLS, mesh_of, pose_of


def message(
    height_mm: np.ndarray, north_m: float = 0.0, east_m: float = 0.0, **changes: Any
) -> dict[str, Any]:
    """A ground message with a map whose south-west corner is 5 m from the middle of its axes."""
    rows, columns = height_mm.shape
    ground: dict[str, Any] = {
        "north_m": north_m,
        "east_m": east_m,
        "down_m": -3.0,
        "touchdown": {"north_m": 0.5, "east_m": 0.0},
        "spots": [{"north_m": 1.0, "east_m": -1.0, "radius_m": 0.5}],
        "map": {
            "rows": rows,
            "columns": columns,
            "north0_m": -5.0,
            "east0_m": -5.0,
            "cell_m": 0.1,
            "height": base64.b64encode(height_mm.astype("<i2").tobytes()).decode(),
            "state": base64.b64encode(np.ones((rows, columns), np.uint8).tobytes()).decode(),
        },
    }
    return ground | changes


def test_the_mesh_is_the_part_of_the_map_around_the_vehicle() -> None:
    rows, columns = np.mgrid[0:100, 0:100]
    ground = message(100 * rows + columns, north_m=1.04, east_m=-2.0)
    mesh = json.loads(mesh_of(ground, ground))
    z = np.frombuffer(base64.b64decode(mesh["height"]), "<i2").reshape(mesh["rows"], mesh["columns"])
    assert (mesh["rows"], mesh["columns"]) == (2 * REACH_CELLS + 1, 30 + REACH_CELLS + 1)
    # the cell of the vehicle, found by the mesh's own corner
    i, j = (1.04 - mesh["n0"]) / mesh["cell"], (-2.0 - mesh["e0"]) / mesh["cell"]
    assert z[int(i), int(j + 1e-6)] == 100 * 60 + 30
    assert mesh["middle"] == pytest.approx(np.median(z) * 1e-3, abs=1e-3)


def test_the_vehicle_stands_up_where_the_message_says_down() -> None:
    ground = message(np.zeros((4, 4)), north_m=2.0)
    assert json.loads(pose_of(ground)) == {
        "n": 2.0,
        "e": 0.0,
        "up": 3.0,
        "disc": [0.5, 0.0, 0.5],
        "spots": [[1.0, -1.0, 0.5]],
    }


def test_nothing_is_drawn_of_an_unknown_map_or_far_away_from_it() -> None:
    unknown = message(np.full((50, 50), NO_HEIGHT))
    assert mesh_of(unknown, unknown) == ""
    away = message(np.zeros((50, 50)), north_m=80.0)
    assert mesh_of(away, away) == ""
    assert mesh_of(None, None) == pose_of(None) == ""


ANYTHING = st.none() | st.booleans() | st.floats() | st.text(max_size=3) | st.lists(st.floats(), max_size=2)


@given(
    st.dictionaries(st.sampled_from(["north_m", "east_m", "down_m", "spots", "touchdown", "map"]), ANYTHING),
    st.dictionaries(st.sampled_from(["north0_m", "east0_m", "cell_m"]), ANYTHING),
)
def test_whatever_a_vehicle_says_is_json_or_nothing(changes: dict[str, Any], grid: dict[str, Any]) -> None:
    good = message(np.zeros((20, 20)))
    odd = good | changes
    for found in (mesh_of(odd, good), mesh_of(good, odd), mesh_of(good, good | {"map": good["map"] | grid})):
        assert found == "" or "NaN" not in json.dumps(json.loads(found))
    assert pose_of(odd) == "" or "Infinity" not in pose_of(odd)


@pytest.mark.skipif(not (CHROMIUM and CHROMEDRIVER), reason="needs chromium and chromedriver")
def test_a_browser_draws_it_and_turns_it(monitor: Monitor, browser: Browser, vehicle: Vehicle) -> None:
    show(browser, monitor, vehicle)
    rows, columns = np.mgrid[0:60, 0:60]
    heights = np.where(rows > 52, 400, 0) + 0 * columns
    heights[:, :10] = NO_HEIGHT
    canvas = "document.getElementById('ground3d')"
    drawn = f"return Number({canvas}.dataset.drawn || 0)"

    def cells() -> int:
        vehicle.bus.put("ground", json.dumps(message(heights)).encode())
        return int(browser.script(f"return Number({canvas}.dataset.cells || 0)"))

    assert eventually(lambda: cells() > 0)
    # the strip of unknown ground is a hole, and what lies beyond the reach is not sent
    shown = json.loads(browser.script(f"return {canvas}.dataset.map"))
    assert cells() == (shown["rows"] - 1) * (shown["columns"] - 1 - max(0, 10 - (50 - REACH_CELLS)))
    colours = browser.script(
        f"const c = {canvas}, d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;"
        "let high = 0, level = 0; for (let i = 0; i < d.length; i += 4)"
        " { if (d[i] > d[i + 2] + 60) high++; else if (d[i] > 120 && d[i + 3] === 255) level++; } return [high, level]"
    )
    assert colours[0] > 50, "the step is orange"
    assert colours[1] > colours[0], "what lies before it is level"
    before = browser.script(drawn)
    browser.script(f"{canvas}.dispatchEvent(new KeyboardEvent('keydown', {{key: 'ArrowLeft'}}))")
    assert eventually(lambda: browser.script(drawn) > before)
    assert browser.errors() == []
