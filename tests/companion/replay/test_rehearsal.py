"""A rehearsal: the recorded flight decides, an autopilot on a real UDP socket gets the real command and answers."""

import json
from pathlib import Path

import pytest
import vehicle_support as vs
from folder_edits import short_flight
from ports import free_udp_port
from replay_support import landslope
from vehicle_support import TestVehicle

from companion import cli


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return short_flight(tmp_path_factory.mktemp("rehearsal") / "short")


@pytest.mark.parametrize(
    ("answer", "reported", "commands"),
    [
        (vs.DENIED, ["landing_refused"], 1),
        (vs.IN_PROGRESS_ACCEPTED, ["landing_in_progress", "landing_accepted", "landing_started"], 1),
        (vs.SILENCE, ["landing_failed"], 4),
    ],
    ids=["denied", "accepted in the end", "no answer"],
)
def test_the_outcome_is_followed_and_reported(
    answer, reported: list[str], commands: int, flight: Path, tmp_path: Path, capsys
):
    port, events = free_udp_port(), tmp_path / "events.jsonl"
    with TestVehicle(port, answer) as vehicle:
        words = ["replay", flight, "--connect", f"udpin:127.0.0.1:{port}", "--events", events]
        words += ["--enable-after", 1, "--set", "decision.dwell_s=0.2"]
        assert cli.main([*map(str, words)]) == 0
        # MAVSDK repeats a command that nobody answers: the same command, at most four times.
        assert 1 <= len(vehicle.land_commands()) <= commands
    names = [json.loads(line)["event"] for line in events.read_text().splitlines()]
    outcome = [name for name in names if name.startswith("landing_") and name != "landing_landed"]
    assert outcome == ["landing_requested", *reported]
    said = capsys.readouterr()
    assert said.err == ""
    assert "requested at" in said.out
    assert said.out.count("command to land") >= len(reported)


def test_no_autopilot_is_one_line_before_the_flight(flight: Path):
    """In a process of its own, with what MAVSDK prints."""
    result = landslope("replay", flight, "--connect", f"udpin:127.0.0.1:{free_udp_port()}")
    assert result.returncode == 2
    assert "no autopilot was heard" in result.stderr
    assert len(result.stderr.splitlines()) == 1


def test_several_flights_cannot_be_rehearsed_at_once(flight: Path, capsys):
    words = ["replay", str(flight), str(flight / "camera.mkv"), "--connect", "udpin:127.0.0.1:1"]
    assert cli.main(words) == 2
    assert "one FLIGHT" in capsys.readouterr().err
