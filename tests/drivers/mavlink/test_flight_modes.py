"""Flight modes by name: sub modes apart, ground stations' spellings understood."""

import pytest

from drivers.mavlink.flight_modes import canonical_mode, known_modes, mode_name
from landing.decision.permission import AUTOMATIC_MODES, ENDS_BY_ITSELF, HOLD_MODES

PX4 = 12


@pytest.mark.parametrize(
    ("main", "sub", "name"),
    [
        (3, 0, "POSCTL"),
        (3, 1, "ORBIT"),
        (3, 2, "POSITION_SLOW"),
        (4, 3, "HOLD"),
        (4, 9, "PRECLAND"),
        (4, 11, "EXTERNAL1"),
        (4, 18, "EXTERNAL8"),
        (6, 0, "OFFBOARD"),
    ],
)
def test_px4s_sub_modes_are_apart(main: int, sub: int, name: str) -> None:
    assert mode_name(PX4, 2, main << 16 | sub << 24) == name


@pytest.mark.parametrize(
    ("spelled", "name"),
    [
        ("Position", "POSCTL"),
        ("position", "POSCTL"),
        ("Hold", "HOLD"),
        ("Altitude", "ALTCTL"),
        ("Return", "RTL"),
        ("Follow Me", "FOLLOWME"),
        ("AltHold", "ALT_HOLD"),
        ("Alt Hold", "ALT_HOLD"),
        ("PosHold", "POSHOLD"),
        ("Smart RTL", "SMART_RTL"),
        ("Guided", "GUIDED"),
        ("QLOITER", "QLOITER"),
        ("Positon", None),
        ("", None),
    ],
)
def test_names_of_ground_stations_are_understood(spelled: str, name: str | None) -> None:
    assert canonical_mode(spelled) == name


def test_every_known_mode_is_its_own_name() -> None:
    assert all(canonical_mode(name) == name for name in known_modes())


def test_modes_that_the_permission_names_exist() -> None:
    named = AUTOMATIC_MODES | HOLD_MODES | {mode for pair in ENDS_BY_ITSELF for mode in pair}
    assert named - known_modes() <= {"AUTO.LAND", "AUTO_LAND"}
