"""The measurement of the daemon's cost gives figures that can be true."""

import pytest

from companion.benchmark import measured_daemon, start_up
from companion.benchmark.latency import measure, table


@pytest.fixture(autouse=True)
def patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine starts a process late."""
    monkeypatch.setattr(measured_daemon, "START_S", 600.0)
    monkeypatch.setattr(measured_daemon, "END_S", 600.0)


def test_figures_of_a_short_run_are_possible() -> None:
    figures = measure(160, 120, 2.0)
    assert 1 < figures.frames <= 75
    assert 0 < figures.software_median_ms <= figures.total_median_ms
    assert figures.software_median_ms <= figures.software_p95_ms
    assert 0 < figures.pipeline_ms_per_frame < figures.cpu_ms_per_frame
    assert set(figures.parts_ms_per_frame) == {"core", "link", "camera", "others"}
    assert 30 < figures.rss_mb < 400
    assert "160x120" in table([figures])


def test_the_daemon_starts_in_any_order_and_ends() -> None:
    figures = start_up.measure(160, 120, (1.5,))
    assert [f.order for f in figures] == list(start_up.FROM)
    for f in figures:
        assert 0 < f.message_s[0] <= f.estimate_s[0]
        assert f.end_s[0] > 0
    printed = start_up.table(figures)
    assert all(order in printed for order in start_up.FROM)
