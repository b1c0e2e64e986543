"""Boards on paper: of the paper's size, as PNG and as PDF whose parts stand where its table says."""

import re
import zlib
from pathlib import Path

import numpy as np
import pytest

from companion.calibration.board import Board
from companion.calibration.paper import PAPERS, on_paper
from companion.cli import main


def test_the_default_board_is_written_as_a_pdf_of_a4(tmp_path: Path):
    path = tmp_path / "board.pdf"
    assert main(["calibrate", "--print-board", str(path), "--dpi", "127"]) == 0
    data = path.read_bytes()
    assert data.startswith(b"%PDF-1.4\n")
    assert data.endswith(b"%%EOF\n")
    across, down = map(float, re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", data).groups())
    assert across * 25.4 / 72 == pytest.approx(297, abs=0.2)
    assert down * 25.4 / 72 == pytest.approx(210, abs=0.2)
    table = int(re.search(rb"startxref\n(\d+)\n", data).group(1))
    assert data[table:].startswith(b"xref\n0 6\n")
    places = [int(place) for place in re.findall(rb"(\d{10}) 00000 n ", data)]
    assert [data[place:].split(b" obj")[0] for place in places] == [b"%d 0" % k for k in range(1, 6)]
    image = zlib.decompress(data[places[4] :].split(b"stream\n", 1)[1])
    page = np.frombuffer(image, np.uint8).reshape(1050, 1485)
    np.testing.assert_array_equal(page, on_paper(Board(), 127, "a4"))


@pytest.mark.parametrize("paper", PAPERS)
def test_the_default_board_fits_every_paper_or_says_so(tmp_path: Path, paper: str, capsys):
    path = tmp_path / "board.png"
    code = main(["calibrate", "--print-board", str(path), "--paper", paper, "--dpi", "72"])
    assert code == 0, capsys.readouterr().err


@pytest.mark.parametrize("name", ["board.jpg", "board", "board.svg"])
def test_other_formats_are_refused(tmp_path: Path, name: str, capsys):
    assert main(["calibrate", "--print-board", str(tmp_path / name), "--dpi", "72"]) == 2
    assert "written as .png or .pdf" in capsys.readouterr().err
    assert not (tmp_path / name).exists()
