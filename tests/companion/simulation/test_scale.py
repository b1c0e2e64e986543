"""Many flights on the workers of a real Dask scheduler, as rows of a Parquet table, and what two tables differ by."""

from pathlib import Path

import pytest
from distributed import LocalCluster

from companion import cli
from companion.simulation import monte_carlo
from companion.simulation.counting.compare import comparison
from companion.simulation.monte_carlo import Run, fly_many
from companion.simulation.result_table import ResultTable, read_rows


def run_of(seed: int, outcome: str = "right", error: str = "") -> Run:
    return Run(seed, "flat", "", outcome, None, None, None, None, None, False, 1.0, 2.0, 3.0, error)


@pytest.mark.slow
def test_two_workers_fly_what_one_process_flies(tmp_path: Path) -> None:
    table = tmp_path / "flights.parquet"
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        words = [
            "sim",
            "--runs",
            "2",
            "--seed",
            "3",
            "--table",
            str(table),
            "--dask",
            cluster.scheduler_address,
        ]
        assert cli.main(words) in (0, 1)
        rows = read_rows(table)
        assert [row["seed"] for row in rows] == [3, 4]
        assert rows[0]["version"]
        # taken up again: what has been flown is not flown again
        parts = set(table.glob("*.parquet"))
        assert cli.main(words) in (0, 1)
        assert parts == set(table.glob("*.parquet"))
    alone = monte_carlo.fly_one(3)
    for name in ("outcome", "requested_s", "inclination_deg", "relief", "chance_s"):
        assert rows[0][name] == getattr(alone, name), name


def test_a_flight_that_broke_the_software_is_a_row_with_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(seed: int, **_: object) -> Run:
        if seed == 2:
            raise ZeroDivisionError("at frame 7")
        return run_of(seed)

    from concurrent.futures import ThreadPoolExecutor

    monkeypatch.setattr(monte_carlo, "fly_one", broken)
    with ResultTable(tmp_path / "t.parquet", None, ()) as table:
        report = fly_many(3, 1, 1, on_run=table.add, pool=lambda: ThreadPoolExecutor(1))
    assert report.crashes == 1
    rows = read_rows(tmp_path / "t.parquet")
    assert [row["outcome"] for row in rows] == ["right", "crashed", "right"]
    assert "at frame 7" in rows[1]["error"]


def test_a_table_is_of_one_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with ResultTable(tmp_path / "t", None, ()) as table:
        table.add(run_of(1))
    assert (
        cli.main(["sim", "--runs", "1", "--table", str(tmp_path / "t"), "--set", "decision.dwell_s=2"]) == 2
    )
    assert "holds flights of other settings; give another folder" in capsys.readouterr().err
    assert cli.main(["compare", str(tmp_path / "none"), str(tmp_path / "t")]) == 2
    assert "there is no Parquet table" in capsys.readouterr().err


def test_a_comparison_names_the_worst_first(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = {1: "right", 2: "missed", 3: "right", 4: "right"}
    after = {1: "missed", 2: "right", 3: "unsafe", 4: "right"}
    for name, outcomes in (("a", before), ("b", after)):
        with ResultTable(tmp_path / name, None, ()) as table:
            for seed, outcome in outcomes.items():
                table.add(run_of(seed, outcome))
    assert cli.main(["compare", str(tmp_path / "a"), str(tmp_path / "b")]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert "4 flights in both tables: 2 worse, 1 better, 1 as before." in lines
    assert lines[-3:] == [
        "- seed 3 (flat): right -> unsafe",
        "- seed 1 (flat): right -> missed",
        "- seed 2 (flat): missed -> right",
    ]
    rows = read_rows(tmp_path / "a")
    assert ": 0 worse" in comparison(rows, rows)
