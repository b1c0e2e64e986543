"""frames.csv as spreadsheets and scripts write it: read where it is meant, else refused in words."""

from pathlib import Path

import folder_edits
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import DriverError
from drivers.files.flight_folder import FlightFolder
from drivers.files.frame_table import read_frame_table

STAMPS = [1795298557172804, 1795298557206137, 1795298557239470]


def table(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


def rows(separator: str = ",", end: str = "\n", stamp: str = "{}") -> str:
    lines = [f"frame{separator}host_time_us"]
    lines += [f"{k}{separator}{stamp.format(us)}" for k, us in enumerate(STAMPS)]
    return end.join([*lines, ""])


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (rows(end="\r\n"), "utf-8-sig"),
        (rows(", ", "\r\n"), "utf-8"),
        (rows(" , "), "utf-8"),
        (rows(stamp="{}.0", end="\r\n"), "utf-8"),
        (rows(stamp='"{}"'), "utf-8"),
        (rows(stamp="{},").replace("us\n", "us,\n"), "utf-8"),
    ],
    ids=["byte order mark", "space", "spaces", "point zero", "quotes", "empty column"],
)
def test_tables_of_spreadsheets_are_read(tmp_path: Path, text: str, encoding: str):
    found = read_frame_table(table(tmp_path / "frames.csv", text, encoding))
    assert [row.stamp_us for row in found.rows.values()] == STAMPS
    assert found.refusals == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (rows(";"), "separated by semicolons: separate them by commas"),
        (rows("\t"), "separated by tabulators"),
        (
            "frame,host_time_us\n0,1795298557.172804\n",
            "line 2 .*1795298557.172804 is no whole number.*seconds",
        ),
        (
            "frame,host_time_us\n0,1,795296E+15\n1,1,795296E+15\n",
            "line 2 .*more values than columns: a decimal comma",
        ),
        ("frame,host_time_us\n0,soon\n", "'soon' is no number"),
        ("frame,host_time_us\n0,1e400\n", "no whole number"),
        ("frame,host_time_us\n0\n", "line 2"),
        ("number,time\n0,1\n", "must name the columns frame and host_time_us"),
        ("", "must name the columns"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_words(tmp_path: Path, text: str, words: str):
    with pytest.raises(DriverError, match=words) as refused:
        read_frame_table(table(tmp_path / "frames.csv", text))
    assert "\n" not in str(refused.value)


def test_one_row_with_too_many_values_is_counted(tmp_path: Path):
    found = read_frame_table(table(tmp_path / "frames.csv", rows() + "3,1,7953E+15\n"))
    assert len(found.rows) == 3
    assert [refusal.reason for refusal in found.refusals] == ["unreadable_row"]


@examples(100)
@given(st.text(max_size=60))
def test_any_text_is_a_table_or_one_line(tmp_path_factory: pytest.TempPathFactory, text: str):
    path = tmp_path_factory.mktemp("table") / "frames.csv"
    path.write_text("frame,host_time_us\n" + text, encoding="utf-8", errors="surrogatepass")
    try:
        said = str(len(read_frame_table(path).rows))
    except DriverError as refused:
        said = str(refused)
    assert said


@pytest.mark.parametrize(("hours", "order"), [(1, "3600 s later"), (-2, "7194 s earlier")])
def test_video_and_telemetry_of_different_times_are_one_line(tmp_path: Path, hours: int, order: str):
    folder = folder_edits.short_flight(tmp_path / "flight", seconds=3.0)
    folder_edits.edit_rows(folder, lambda rows: [[n, str(int(t) + hours * 3_600_000_000)] for n, t in rows])
    with pytest.raises(DriverError, match="video and telemetry do not overlap") as refused:
        FlightFolder(folder)
    text = str(refused.value)
    assert "\n" not in text
    assert text.count("UTC, ") + text.count("UTC: ") == 2  # both spans
    assert order.split()[-1] in text


def test_rounded_stamps_are_one_line(tmp_path: Path):
    folder = folder_edits.short_flight(tmp_path / "flight", seconds=1.0)
    middle = int((folder / "frames.csv").read_text().splitlines()[10].split(",")[1])
    folder_edits.edit_rows(folder, lambda rows: [[n, str(middle)] for n, _ in rows])
    with pytest.raises(DriverError, match=r"different stamps.*rounded"):
        FlightFolder(folder)
