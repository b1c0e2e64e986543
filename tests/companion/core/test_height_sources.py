"""A rangefinder through the core: it stands in for a velocity, is fused with it, and contradicts it."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from companion.core.core import Core
from companion.messages.messages import Estimate, Event, Health
from companion.replay.source import PlainCamera, open_source
from drivers.samples import Attitude, Distance, Sample, Velocity

EVERY = 10
"""Attitudes from distance to distance."""


def with_range(samples: Iterator[Sample], height_m: float, velocity: bool) -> Iterator[Sample]:
    """A rangefinder that measures ``height_m`` all the time; whether the velocity comes."""
    count = itertools.count()
    for sample in samples:
        if isinstance(sample, Attitude) and next(count) % EVERY == 0:
            yield Distance(sample.arrival_us, sample.boot_us, height_m, 0.05, 0.1, 40.0)
        if velocity or not isinstance(sample, Velocity):
            yield sample


def flown(
    flight: Path, height_m: float = 0.0, velocity: bool = True
) -> tuple[list[Estimate], list[str], Health]:
    """Estimates, names of events and the last health of a flight."""
    source = open_source(flight, None, (), PlainCamera())
    settings = replace(source.settings, vehicle=replace(source.settings.vehicle, rangefinder=height_m > 0))
    core = Core(settings, source.camera, calibrated=True, telemetry=True)
    out = []
    samples = (sample for sample in source.samples() if not isinstance(sample, Distance))
    for sample in with_range(samples, height_m, velocity) if height_m else samples:
        out += core.feed(sample)
    out += core.finish()
    healths = [message for message in out if isinstance(message, Health)]
    names = [message.event for message in out if isinstance(message, Event)]
    return [message for message in out if isinstance(message, Estimate)], names, healths[-1]


@pytest.fixture(scope="module")
def true_m(recorded: Path) -> float:
    """The height of the flight, which is level, by velocity and ventral flow."""
    found, _, _ = flown(recorded)
    heights = [e.height_m for e in found if e.height_m is not None]
    assert len(heights) > 20
    assert {e.height_source for e in found} == {None, "velocity"}
    return sorted(heights)[len(heights) // 2]


def test_it_is_fused_with_the_velocity(recorded: Path, true_m: float) -> None:
    found, events, health = flown(recorded, true_m)
    both = [e for e in found if e.height_source == "both"]
    assert len(both) > 20
    assert all(e.height_m == pytest.approx(true_m, rel=0.1) for e in both)
    assert "height_contradicts" not in events
    assert health.inputs["distance"].count > 20


def test_it_stands_in_where_there_is_no_velocity(recorded: Path, true_m: float) -> None:
    found, _, _ = flown(recorded, true_m, velocity=False)
    alone = [e for e in found if e.height_m is not None]
    assert len(alone) > 20
    assert {e.height_source for e in alone} == {"rangefinder"}
    assert all(e.height_m == pytest.approx(true_m, rel=0.1) for e in alone)


def test_one_that_measures_something_else_ends_the_estimates(recorded: Path, true_m: float) -> None:
    found, events, health = flown(recorded, true_m / 10)
    assert "height_contradicts" in events
    assert found[-1].status == "height_contradicts"
    assert found[-1].height_m is None
    assert "height_contradicts" in {condition.code for condition in health.conditions}
