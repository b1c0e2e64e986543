"""What doctor says of a rangefinder: absent, unused, out of reach, in order."""

import pytest

from companion.doctor.rangefinder import rangefinder_findings
from drivers.samples import Distance


@pytest.mark.parametrize(
    ("wanted", "metres", "limits", "level", "word"),
    [
        (True, 3.2, (0.1, 40.0), "ok", "3.20 m"),
        (True, None, (0.1, 40.0), "ok", "nothing in reach"),
        (True, None, (0.1, 0.0), "warning", "0.1 to 0 m"),
        (False, 3.2, (0.1, 40.0), "ok", "not used"),
    ],
)
def test_a_rangefinder_that_reports(
    wanted: bool, metres: float | None, limits: tuple[float, float], level: str, word: str
) -> None:
    (found,) = rangefinder_findings(wanted, [Distance(0, 0, metres, None, *limits)])
    assert found.level == level
    assert word in found.text


def test_one_that_does_not() -> None:
    assert rangefinder_findings(False, []) == []
    (found,) = rangefinder_findings(True, [])
    assert found.level == "warning"
    assert "vehicle.rangefinder" in found.remedy
