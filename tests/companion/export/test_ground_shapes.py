"""The ground map for Foxglove: a grid and discs at known places, read back from an MCAP file."""

import math
from pathlib import Path

import numpy as np
import pytest
from export_support import Recording

from companion.export.mcap_sink import McapSink
from companion.export.shapes import CELL
from companion.messages.ground import ground_message
from drivers.samples import Velocity
from landing.ground.ground import GroundReport, MapView
from landing.ground.spots import Disc, Spot
from landing.vision.camera import CameraModel

HEIGHT = np.array(((0.1, 0.2, math.nan), (0.0, 0.1, 0.3)))
STATE = np.array(((2, 1, 0), (2, 3, 1)), np.uint8)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    path: Path = tmp_path_factory.mktemp("ground") / "ground.mcap"
    sink = McapSink(path, "vehicle1", CameraModel.from_focal(320, 240, 256.0))
    sink.sample(Velocity(0, 0, (100.0, 50.0, -4.0), (0.0, 0.0, 0.0)))
    # in the map's axes the vehicle is 3 m up, at 5 m north and 2 m west
    report = GroundReport(
        7,
        1.0,
        np.array((5.0, -2.0, -3.0)),
        Disc("landable", (), 1.0, 0.2, 0.01, 1.0),
        Disc("hazard", (), 20.0, 0.2, 0.3, 1.0),
        0.4,
        0.0,
        (Spot(0.5, -0.25, 0.5, 1.0, 0.01, 0.3),),
    )
    sink.put(ground_message(report, 1_000_000, 1.0, MapView(4.9, -2.1, HEIGHT, STATE)))
    sink.close()
    return Recording(path)


def test_the_grid_has_every_cell_where_it_is(recording: Recording) -> None:
    ((_, grid),) = recording.protobuf("ground/map")
    cells = np.frombuffer(grid.data, CELL).reshape(2, 3)
    np.testing.assert_array_equal(cells["state"], STATE)
    np.testing.assert_allclose(cells["elevation"], HEIGHT, atol=1e-6)
    assert [cell["alpha"] for cell in cells.ravel()] == [255, 255, 0, 255, 255, 255]
    assert (grid.column_count, grid.row_stride, grid.cell_stride) == (3, 27, 9)
    assert [(f.name, f.offset) for f in grid.fields] == [
        (name, CELL.fields[name][1]) for name in ("elevation", "state", "red", "green", "blue", "alpha")
    ]
    p, q = grid.pose.position, grid.pose.orientation
    # north, east and down of the corner; the map's zero height is 3 m below the vehicle
    np.testing.assert_allclose((p.x, p.y, p.z), (99.9, 49.9, -1.0), atol=1e-9)
    # columns go east and rows north: the turn takes x to NED's y
    x, y, z, w = q.x, q.y, q.z, q.w
    columns = (1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w))
    np.testing.assert_allclose(columns, (0, 1, 0), atol=1e-9)


def test_spots_and_touchdown_lie_on_the_ground(recording: Recording) -> None:
    ((_, update),) = recording.protobuf("ground/discs")
    spot, stop = update.entities[0].cylinders
    level = float(np.nanmean(HEIGHT))
    np.testing.assert_allclose(
        (spot.pose.position.x, spot.pose.position.y, spot.pose.position.z),
        (100.5, 49.75, -1.0 - level),
        atol=1e-3,
    )
    assert spot.size.x == pytest.approx(1.0)
    assert stop.pose.position.x == pytest.approx(100.4)
    assert stop.color.r > stop.color.g
