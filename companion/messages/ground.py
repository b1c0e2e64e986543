"""The ``ground`` message: the discs below and at the stopping point, the landing spots, and at a lower rate the map.

In: the ``GroundReport`` of a frame (NaN: unknown) and, when it is due, a ``MapView``. Out: the message, null where
unknown.
"""

import base64
from typing import Annotated, Any

import msgspec
import numpy as np

from companion.messages.fields import about, known
from landing.ground.ground import GroundReport, MapView
from landing.ground.map import CELL_M
from landing.ground.spots import Disc, GroundCode, Spot

NO_HEIGHT = -32768
"""Height of an unknown cell in the packed map."""


class GroundDisc(msgspec.Struct, frozen=True, kw_only=True):
    """A disc of ground of the vehicle's own size."""

    verdict: Annotated[str, about('"landable", "hazard" or "unknown"')]
    reasons: Annotated[
        tuple[str, ...],
        about("codes of what speaks against landing; empty when it is landable", one_of=GroundCode),
    ]
    inclination_deg: Annotated[float | None, about("angle of the disc's plane to level", "deg")]
    inclination_std_deg: Annotated[float | None, about("standard deviation of inclination_deg", "deg")]
    step_m: Annotated[float | None, about("largest distance of the ground from the disc's plane", "m")]
    known: Annotated[float, about("share of the disc that is measured")]


class Touchdown(GroundDisc, frozen=True, kw_only=True):
    """The worst disc of ground from straight below to where the vehicle would come down."""

    north_m: Annotated[float | None, about("the stopping point, from the vehicle", "m")]
    east_m: Annotated[float | None, about("the stopping point, from the vehicle", "m")]


class LandingSpot(msgspec.Struct, frozen=True, kw_only=True):
    """A landable disc."""

    north_m: Annotated[float, about("its middle, from the vehicle", "m")]
    east_m: Annotated[float, about("its middle, from the vehicle", "m")]
    radius_m: Annotated[float, about("its radius", "m")]
    inclination_deg: Annotated[float, about("angle of its plane to level", "deg")]
    step_m: Annotated[float, about("largest distance of the ground from its plane", "m")]
    clearance_m: Annotated[float, about("how far it can be moved until it is not landable any more", "m")]


class GroundCells(msgspec.Struct, frozen=True, kw_only=True):
    """The known part of the map, row by row from the south-west corner: rows go north, columns east."""

    north0_m: Annotated[float, about("corner of the cells, in the map's axes", "m")]
    east0_m: Annotated[float, about("corner of the cells, in the map's axes", "m")]
    cell_m: Annotated[float, about("side of a cell", "m")]
    rows: Annotated[int, about("cells to the north")]
    columns: Annotated[int, about("cells to the east")]
    height: Annotated[
        str,
        about(
            "height in the map's axes, up: base64 of 16-bit integers, low byte first; -32768: unknown", "mm"
        ),
    ]
    state: Annotated[
        str,
        about("base64 of bytes: 0 unknown, 1 measured, 2 measured and its disc landable, 3 looks disagree"),
    ]


class Ground(msgspec.Struct, frozen=True, kw_only=True):
    """What of the ground can be landed on. Places are north and east, from the vehicle unless said."""

    frame: Annotated[int, about("number of the camera frame that places count from")]
    time_unix_us: Annotated[int, about("middle of that frame's exposure, companion clock since 1970", "us")]
    time_boot_s: Annotated[float | None, about("the same instant in the autopilot's time since boot", "s")]
    north_m: Annotated[float, about("the vehicle in the map's axes", "m")]
    east_m: Annotated[float, about("the vehicle in the map's axes", "m")]
    down_m: Annotated[float, about("the vehicle in the map's axes", "m")]
    below: Annotated[GroundDisc, about("the disc straight below")]
    touchdown: Annotated[Touchdown, about("the disc where the vehicle would come down now")]
    spots: Annotated[tuple[LandingSpot, ...], about("discs that can be landed on, best first")]
    map: Annotated[GroundCells | None, about("the map, at its own rate; null between")]


def ground_message(
    report: GroundReport, time_unix_us: int, time_boot_s: float | None, view: MapView | None
) -> Ground:
    """The message for a report of the ground, with the map where ``view`` has it."""
    north, east, down = (round(float(part), 3) for part in report.place_ned)
    return Ground(
        frame=report.frame,
        time_unix_us=time_unix_us,
        time_boot_s=None if time_boot_s is None else round(time_boot_s, 6),
        north_m=north,
        east_m=east,
        down_m=down,
        below=GroundDisc(**_disc(report.below)),
        touchdown=Touchdown(
            **_disc(report.touchdown),
            north_m=known(report.touchdown_north_m, 3),
            east_m=known(report.touchdown_east_m, 3),
        ),
        spots=tuple(_spot(spot) for spot in report.spots),
        map=None if view is None else _cells(view),
    )


def _disc(disc: Disc) -> dict[str, Any]:
    return {
        "verdict": disc.verdict,
        "reasons": tuple(code.value for code in disc.reasons),
        "inclination_deg": known(disc.inclination_deg, 3),
        "inclination_std_deg": known(disc.inclination_std_deg, 3),
        "step_m": known(disc.step_m, 4),
        "known": round(disc.known, 3),
    }


def _spot(spot: Spot) -> LandingSpot:
    return LandingSpot(
        north_m=round(spot.north_m, 3),
        east_m=round(spot.east_m, 3),
        radius_m=spot.radius_m,
        inclination_deg=round(spot.inclination_deg, 3),
        step_m=round(spot.step_m, 4),
        clearance_m=round(spot.clearance_m, 3),
    )


def _cells(view: MapView) -> GroundCells:
    rows, columns = view.height_m.shape
    limit = -NO_HEIGHT - 1
    whole = np.where(np.isfinite(view.height_m), view.height_m * 1e3, NO_HEIGHT)
    height = np.rint(np.clip(whole, NO_HEIGHT, limit)).astype("<i2")
    return GroundCells(
        north0_m=round(view.north0_m, 3),
        east0_m=round(view.east0_m, 3),
        cell_m=CELL_M,
        rows=rows,
        columns=columns,
        height=base64.b64encode(height.tobytes()).decode(),
        state=base64.b64encode(view.state.astype(np.uint8).tobytes()).decode(),
    )
