"""The printed schemas are valid, describe the real messages, and the documentation repeats them."""

import json

import jsonschema
import msgspec
import numpy as np
import pytest
from places import REPOSITORY

from companion.cli import main
from companion.messages import schema
from companion.messages.messages import (
    TOPICS,
    Decision,
    Event,
    Health,
    InputHealth,
    encode,
    estimate_message,
)
from companion.messages.preview import overlay
from drivers.samples import Frame
from landing.estimate import SurfaceEstimate, TrackView

DOCS = REPOSITORY / "docs"


def example(name: str) -> bytes:
    """A real message of each kind as it goes out."""
    estimate = SurfaceEstimate(
        frame=3, time_s=0.1, status="ok", method="map", inclination_deg=12.5, against_flat=("12.5 > 10 deg",)
    )
    match name:
        case "estimate":
            return encode(estimate_message(estimate, 1_700_000_000_000_000, None, True))
        case "decision":
            return encode(
                Decision(
                    frame=3,
                    time_unix_us=1,
                    verdict="unfit",
                    reasons=("steep",),
                    since_unix_us=1,
                    permitted=False,
                    withheld=(),
                    requested=False,
                    command="none",
                )
            )
        case "health":
            one = InputHealth(state="ok", count=1, refused=0, rate_hz=30.0, age_s=None)
            return encode(
                Health(
                    time_unix_us=1,
                    state="ok",
                    problems=(),
                    inputs={"camera": one},
                    counters={"a": 1},
                    clock_offset_s=None,
                    clock_std_s=None,
                    camera_late_s=None,
                    camera_late_std_s=None,
                    pipeline_ms=4.0,
                )
            )
        case "event":
            return encode(Event(event="start", frame=None, time_unix_us=1, severity="info", text="started"))
    tracks = TrackView(
        previous_px=np.array([[1.0, 2.0], [np.nan, 4.0]]),
        current_px=np.array([[2.0, 2.0], [3.0, 4.0]]),
        inlier=np.array([True, False]),
        height=np.zeros(2),
    )
    seen = SurfaceEstimate(frame=3, time_s=0.1, status="ok", method="map", tracks=tracks)
    frame = Frame(number=3, stamp_us=1, arrival_us=1, image=np.zeros((240, 320), np.uint8))
    return msgspec.json.encode(overlay(frame, seen, 1, 100))


@pytest.mark.parametrize("name", [topic.name for topic in TOPICS])
def test_real_messages_satisfy_their_schema_and_broken_ones_do_not(name: str) -> None:
    wanted = schema.schema_of(name)
    jsonschema.Draft202012Validator.check_schema(wanted)
    message = json.loads(example(name))
    jsonschema.validate(message, wanted)
    for field in wanted["required"]:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate({k: v for k, v in message.items() if k != field}, wanted)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**message, "time_unix_us": "yesterday"}, wanted)


def test_every_field_has_a_meaning_and_units_agree_with_names() -> None:
    units = {"_us": "us", "_s": "s", "_deg": "deg", "_m": "m", "_px": "px", "_hz": "Hz", "_ms": "ms"}
    for name, wanted in schema.all_schemas().items():
        for title, part in (("", wanted), *wanted.get("$defs", {}).items()):
            for field, about in part["properties"].items():
                assert about.get("description"), f"{name} {title} {field} has no meaning"
                for ending, unit in units.items():
                    if field.endswith(ending):
                        assert about.get("unit") == unit, f"{name} {title} {field}"


def test_the_documentation_holds_the_tables_as_they_are_now() -> None:
    assert schema.tables() in (DOCS / "messages.md").read_text(), (
        "docs/messages.md is behind: put the output of 'landslope schema --table' at its end"
    )


def test_the_documentation_shows_the_example_as_it_is() -> None:
    code = (DOCS / "examples" / "subscriber.py").read_text().split('"""\n', 1)[1].strip()
    assert code in (DOCS / "messages.md").read_text()
    assert len([line for line in code.splitlines() if line.strip()]) <= 10


def test_the_command_prints_one_schema_or_all(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "event"]) == 0
    assert json.loads(capsys.readouterr().out)["title"] == "Event"
    assert main(["schema"]) == 0
    assert set(json.loads(capsys.readouterr().out)) == {topic.name for topic in TOPICS}
    assert main(["schema", "land"]) == 2
    assert "no message 'land'" in capsys.readouterr().err
