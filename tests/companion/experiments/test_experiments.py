"""The paper's experiments: the statistics, the jobs and the whole command."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from companion.cli import main
from companion.errors import LandslopeError
from companion.experiments import flatness, handheld, slopes, stairs, zoom
from companion.experiments.measure import FRAME_S, METHODS, Errors, Outcome, auc, camera_of, estimate_all
from companion.experiments.report import Table, markdown_table
from drivers.simulated.world.sequences import plane_sequence
from landing.estimate import SurfaceEstimate


def test_errors_count_failures_and_take_absolute_values() -> None:
    errors = Errors.of([-1.0, 2.0, math.nan, 3.0])
    assert (errors.median, errors.worst, errors.frames, errors.failures) == (2.0, 3.0, 4, 1)
    assert errors.p95 == pytest.approx(2.9)
    assert errors.cells() == ["2.00", "2.90", "3.00", "1 of 4"]
    assert math.isnan(Errors.of([math.nan]).median)


def test_auc_is_the_share_of_pairs_in_order() -> None:
    assert auc(np.array([1.0, 2.0, np.nan]), np.array([3.0, 2.0])) == pytest.approx(3.5 / 4)
    assert math.isnan(auc(np.array([np.nan]), np.array([1.0])))


def test_relative_errors_are_against_the_truth_of_each_frame() -> None:
    estimates = [
        SurfaceEstimate(k, k / 30, "ok", "map", time_to_contact_s=t / 30) for k, t in enumerate((9, 11, 9))
    ]
    outcome = Outcome({"name": "x"}, {"tau": np.array([10.0, 10.0, 9.0])}, {"map": estimates})
    assert zoom.relative_error(outcome, "map") == pytest.approx([0.1, 0.0])


def test_every_experiment_runs_every_slope_and_motion_of_the_paper() -> None:
    labels = [j.arguments for j in slopes.jobs(False, 1)]
    assert {(a["slope_deg"], a["motion"]) for a in labels} == {
        (s, m) for s in (0, 15, 30, 45, 60) for m in "xyz"
    }
    assert len(zoom.jobs(False, 1)) == 5
    assert {a.arguments["tau"] for a in zoom.jobs(False, 1)} == {200}
    assert {a.arguments["known"] for a in handheld.jobs(False, 1)} == {True, False}
    assert {a.arguments["structured"] for a in flatness.jobs(False, 1)} == {True, False}
    assert {a.arguments["use_attitude"] for a in stairs.jobs(False, 1)} == {True, False}


def test_a_job_gives_the_same_twice() -> None:
    job = slopes.jobs(True, 3)[0]
    first, second = job(), job()
    # As text, because NaN is not equal to itself.
    assert repr(first.estimates) == repr(second.estimates)
    assert first.ok("map").any()


def test_tables_are_markdown() -> None:
    assert markdown_table(Table("T", ["a", "b"], [["1", "2"]])) == "T\n\n| a | b |\n|---|---|\n| 1 | 2 |"


def zoom_folder(path: Path, tau: int, count: int) -> Path:
    """Pictures of an approach, numbered as ``--images`` wants them: picture k has ``tau`` - k frames to contact."""
    s = plane_sequence("noise", motion="z", n=count, tau=tau - 1, distance=3.0, samples=2)
    path.mkdir()
    for k, image in enumerate(s.images, 1):
        cv2.imwrite(str(path / f"image_{k}.png"), image)
    return path


def table_of(report: str, caption: str) -> dict[tuple[str, str], list[str]]:
    """The rows of a table by their first two cells, without the marks of bold type."""
    lines = report.split(caption, 1)[1].split("\n\n")[1].splitlines()[2:]
    rows = [[cell.strip(" *") for cell in line.strip("|").split("|")] for line in lines]
    return {(row[0], row[1]): row for row in rows}


@pytest.mark.slow
def test_the_whole_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    images = zoom_folder(tmp_path / "approach", 40, 30)
    out = tmp_path / "out"
    arguments = ["experiments", "--quick", "--out", str(out), "--images", str(images), "--images-tau", "40"]
    assert main([*arguments, "--images-focal", "274.5", "--jobs", "1"]) == 0
    assert "report.md written" in capsys.readouterr().out
    report = (out / "report.md").read_text(encoding="utf-8")
    for name in (
        "fig4.png",
        "fig4_images.png",
        "fig5.png",
        "fig5_flow.png",
        "fig6.png",
        "fig8.png",
        "fig9.png",
    ):
        assert f"({name})" in report
        picture = cv2.imread(str(out / name))
        assert picture is not None
        assert picture.std() > 5
    for figure in ("Fig. 4", "Fig. 5", "Figs. 6 and 7", "Fig. 8", "Figs. 9 and 11"):
        assert f"| {figure} |" in report
    for method in METHODS:
        assert f"{method}: median" in report
    zooms = table_of(report, "Relative error of time to contact, %.")
    assert float(zooms["quadratic", "noise"][2]) <= 3
    assert float(zooms["map", "noise"][2]) <= 1
    folder = table_of(
        report.split("on the images of approach\n", 1)[1], "Relative error of time to contact, %."
    )
    assert float(folder["quadratic", "approach"][2]) <= 3
    pooled = table_of(report, "Slope error, degrees.")
    assert float(pooled["Y", "quadratic"][3]) <= 1
    assert float(pooled["Y", "map"][3]) <= 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--images", "{tmp}/none"], "is not a folder"),
        (["--jobs", "0"], "--jobs must lie between 1 and 64, got 0"),
        (["--images", "{tmp}", "--images-focal", "-1"], "--images-focal must be positive"),
    ],
)
def test_wrong_arguments_are_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [a.format(tmp=tmp_path) for a in arguments]
    assert main(["experiments", "--quick", "--out", str(tmp_path / "out"), *words]) == 2
    assert message in capsys.readouterr().err


def test_a_folder_with_gaps_or_without_images_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LandslopeError, match="0 numbered images"):
        zoom.folder(str(tmp_path), 274.5, 100)
    for k in (1, 2, 4):
        cv2.imwrite(str(tmp_path / f"image_{k}.png"), np.zeros((64, 64), np.uint8))
    with pytest.raises(LandslopeError, match="not numbered without gaps"):
        zoom.folder(str(tmp_path), 274.5, 100)
    (tmp_path / "image_3.png").write_bytes(b"no picture")
    with pytest.raises(LandslopeError, match="cannot be read"):
        zoom.folder(str(tmp_path), 274.5, 100)


@pytest.mark.parametrize("method", METHODS)
def test_a_distant_fine_texture_gives_the_estimators_no_false_flow(method: str) -> None:
    """Stones of 5 cm from 40 m, 4 cm a texel under pixels of 15 cm: aliased, they would move by themselves."""
    s = plane_sequence("gravel", 15, axis="y", motion="x", n=14, distance=40.0, omega=0.01, samples=2)
    estimates = estimate_all(list(s.images), camera_of(s.lens), [np.eye(3)] * 14)[method]
    for e in estimates[6:]:
        assert e.status == "ok"
        assert e.slope_y_deg == pytest.approx(15, abs=1.5)
        assert e.slope_x_deg == pytest.approx(0, abs=1.5)
        assert e.ventral_flow_x * FRAME_S == pytest.approx(0.01, rel=0.02)
        assert abs(e.ventral_flow_y * FRAME_S) < 2e-4
