"""Many flights on the workers of a real Dask scheduler, as rows of a Parquet table, and what two tables differ by."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from distributed import LocalCluster
from flight_copy import short_flight
from places import REPOSITORY

from companion import cli
from companion.commands.experiments import run_jobs
from companion.experiments import slopes
from companion.replay.many import replay_one
from companion.replay.replay import ReplayJob
from companion.simulation import monte_carlo
from companion.simulation.counting.compare import comparison
from companion.simulation.monte_carlo import Run, fly_many
from companion.simulation.result_table import ResultTable, read_rows
from drivers.files import row_table
from drivers.system import pools
from drivers.system.pools import dask


def run_of(seed: int, outcome: str = "right", error: str = "") -> Run:
    return Run(seed, "flat", "", outcome, None, None, None, None, None, False, 1.0, 2.0, 3.0, error)


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """The address of a real scheduler with two workers, processes of their own."""
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
def test_a_worker_flies_what_this_process_flies(tmp_path: Path, scheduler: str) -> None:
    table = tmp_path / "flights.parquet"
    words = ["sim", "--runs", "1", "--seed", "3", "--table", str(table), "--dask", scheduler]
    assert cli.main(words) in (0, 1)
    rows = read_rows(table)
    assert [row["seed"] for row in rows] == [3]
    assert rows[0]["version"]
    # taken up again: what has been flown is not flown again
    parts = set(table.glob("*.parquet"))
    assert cli.main(words) in (0, 1)
    assert parts == set(table.glob("*.parquet"))
    alone = monte_carlo.fly_one(3)
    for name in (
        "outcome", "requested_s", "inclination_deg", "relief", "patch_inclination_deg", "fit_s", "chance_s"
    ):  # fmt: skip
        assert rows[0][name] == getattr(alone, name), name
    assert alone.requested_s is not None


def test_recorded_flights_are_rows_wherever_they_lie_and_whoever_replays_them(
    tmp_path: Path, scheduler: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two workers and a list of a path and of fsspec's addresses; one flight is broken, and one comes later."""
    first = short_flight(tmp_path / "flights" / "first", seconds=2.0)
    shutil.copytree(first, tmp_path / "flights" / "broken")
    (tmp_path / "flights" / "broken" / "camera.mkv").write_bytes(b"")
    listed, table = tmp_path / "list.txt", tmp_path / "replayed.parquet"
    listed.write_text(f"# two flights\nfile://{tmp_path / 'flights'}\n")
    words = ["replay", "--list", str(listed), "--dask", scheduler, "--table", str(table)]
    assert cli.main(words) == 2
    said = capsys.readouterr()
    assert "2 flights in" in said.out
    assert "1 could not be replayed" in said.out
    assert len(said.err.splitlines()) == 1
    rows = {Path(row["flight"]).name: row for row in row_table.read_rows(table)}
    assert "camera.mkv" in rows["broken"]["error"]
    assert rows["broken"]["inclination_deg"] is None
    alone = replay_one(ReplayJob("first", first)).row
    for name in ("frames", "seconds", "estimates", "fit", "inclination_deg", "against", "trouble", "error"):
        assert rows["first"][name] == getattr(alone, name), name
    assert alone.frames == 60
    # taken up again with one more: what has a row is not replayed again
    later = shutil.copytree(first, tmp_path / "later")
    assert cli.main([*words, str(later)]) == 0
    assert "1 flights in" in capsys.readouterr().out
    assert len(row_table.read_rows(table)) == 3
    assert cli.main([*words, "--set", "decision.dwell_s=2"]) == 2
    assert "holds flights of other settings" in capsys.readouterr().err


def test_experiments_on_two_workers_give_what_this_process_gives(scheduler: str) -> None:
    (job, *_) = slopes.jobs(True, 3)
    ((outcome,),) = run_jobs({"slopes": [job]}, dask(scheduler), 2).values()
    assert repr(outcome.estimates) == repr(job().estimates)


@pytest.mark.parametrize(
    "words", [["sim", "--runs", "1"], ["replay", "sitl_logs/stairs_a"], ["experiments", "--quick"]]
)
def test_without_a_scheduler_it_is_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(pools, "ANSWER_S", 0.1)
    monkeypatch.chdir(REPOSITORY)
    out = ["--out", str(tmp_path)] if words[0] == "experiments" else []
    assert cli.main([*words, *out, "--dask", "tcp://127.0.0.1:9"]) == 2
    assert "no scheduler answers" in capsys.readouterr().err


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
