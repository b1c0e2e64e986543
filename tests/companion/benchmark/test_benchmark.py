"""The benchmark: it runs, prints every row, and its parts add up."""

import argparse
from pathlib import Path

import cv2
import numpy as np
import pytest

from companion import cli
from companion.benchmark import benchmark
from companion.commands.benchmark import sizes
from companion.errors import LandslopeError

START, FRAMES = 40, 30


@pytest.fixture(scope="module")
def material(recorded: Path) -> benchmark.Material:
    return benchmark.read(recorded, START, FRAMES)


def test_the_command_prints_every_row(recorded: Path, capsys: pytest.CaptureFixture[str]):
    threads = cv2.getNumThreads()
    words = ["benchmark", "--flight", str(recorded), "--sizes", "160x120,200x150"]
    words += ["--frames", str(FRAMES), "--start", str(START)]
    assert cli.main(words) == 0
    assert cv2.getNumThreads() == threads
    printed = capsys.readouterr().out
    rows = {line[:34].strip(): line[34:].split() for line in printed.splitlines()}
    for stage in benchmark.STAGES:
        assert "did not run" not in " ".join(rows[stage])
        assert float(rows[stage][0]) >= 0
    for row in ("OpenCV alone", "rest", "whole pipeline", "whole pipeline / OpenCV alone"):
        assert len(rows[row]) == 2
        assert all(float(value) > 0 for value in rows[row])
    assert rows["frames"] == ["19", "19"]


def test_every_stage_and_the_rest_are_measured(material: benchmark.Material):
    before = {place: getattr(*place) for places in benchmark.STAGES.values() for place in places}
    figures = benchmark.measure(benchmark.resized(material, 160, 120))
    assert set(figures.stages) == set(benchmark.STAGES)
    assert all(stage.share >= 0 for stage in figures.stages.values())
    assert figures.whole_mean_ms > 0
    assert figures.ratio == figures.whole_ms / figures.opencv_ms

    assert {place: getattr(*place) for place in before} == before, "nothing stays wrapped"


def test_a_resized_camera_sees_the_same_directions(material: benchmark.Material):
    small = benchmark.resized(material, 160, 120)
    corners = np.array(((-0.5, -0.5), (319.5, -0.5), (160.0, 120.0), (319.5, 239.5)))
    directions = material.camera.undistort(corners)
    assert small.camera.undistort((corners + 0.5) / 2 - 0.5) == pytest.approx(directions, abs=1e-6)
    assert small.observations[0].image.shape == (120, 160)


def test_too_few_frames_are_refused(recorded: Path):
    with pytest.raises(LandslopeError, match="lower --start"):
        benchmark.read(recorded, 100_000, 40)


@pytest.mark.parametrize("text", ["320", "320x", "x240", "axb", "320x240,", "10x10", "99999x240", "-320x240"])
def test_sizes_that_are_none_are_refused(text: str):
    with pytest.raises(argparse.ArgumentTypeError):
        sizes(text)
