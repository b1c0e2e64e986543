"""The printed schemas are valid, describe the real messages, and the documentation repeats them."""

import json
import math
import re

import jsonschema
import msgspec
import numpy as np
import pytest
from places import REPOSITORY

from companion.cli import main
from companion.messages import schema
from companion.messages.events import COMMAND_EVENTS, EVENTS, LANDING_EVENTS
from companion.messages.ground import ground_message
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
from landing.ground.ground import GroundReport, MapView
from landing.ground.spots import Disc, GroundCode, Spot
from landing.reasons import MEANING, STATUS_MEANING, Certainty, Code, Reason, Status, words

DOCS = REPOSITORY / "docs"
STEEP = Reason(Code.TOO_STEEP, Certainty.CERTAIN, 12.5, limit=10.0)


def example(name: str) -> bytes:
    """A real message of each kind as it goes out."""
    estimate = SurfaceEstimate(
        frame=3, time_s=0.1, status="ok", method="map", inclination_deg=12.5, against_flat=(STEEP,)
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
                    reason_codes=(str(STEEP.code),),
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
        case "ground":
            below = Disc("hazard", (GroundCode.STEP,), 1.0, 0.3, 0.2, 1.0)
            spot = Spot(1.0, -0.5, 0.5, 1.0, 0.02, 0.7)
            report = GroundReport(3, 0.1, np.zeros(3), below, Disc("unknown", ()), math.nan, 0.0, (spot,))
            view = MapView(-1.0, 2.0, np.array([[0.1, math.nan]]), np.array([[2, 0]], np.uint8))
            return encode(ground_message(report, 1, None, view))
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


def test_every_reason_and_status_has_a_meaning_and_words() -> None:
    assert list(MEANING) == list(Code)
    assert list(STATUS_MEANING) == list(Status)
    for certainty in Certainty:
        said = {words(Reason(code, certainty, 1, 2, 3, 4, "no_fit")) for code in Code}
        assert len(said) == len(Code)
        assert not any("{" in text or "_" in text for text in said)


def test_a_code_that_is_not_in_the_table_is_not_in_the_schema() -> None:
    wanted = schema.schema_of("decision")
    message = json.loads(example("decision"))
    jsonschema.validate(message, wanted)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**message, "reason_codes": ["too_stony"]}, wanted)


EVENT_CALLS = re.compile(
    r'(?:DriverEvent|Event|event|Notice|_tell|_event|_say)\(\s*(?:event=)?"([a-z]+(?:_[a-z]+)+)"'
)


def test_every_event_that_the_code_makes_is_in_the_table() -> None:
    made = {
        (name, file.name)
        for folder in ("companion", "drivers")
        for file in (REPOSITORY / folder).rglob("*.py")
        for name in EVENT_CALLS.findall(file.read_text())
    }
    assert len(made) > 15, "the search finds nothing any more"
    assert not {(name, file) for name, file in made if name not in EVENTS}


def test_every_event_of_a_landing_is_listed_as_one():
    of_the_permission = {"landing_enabled", "landing_disabled"}
    assert {name for name in EVENTS if name.startswith("landing_")} - of_the_permission == LANDING_EVENTS
    assert EVENTS.keys() >= COMMAND_EVENTS >= LANDING_EVENTS
