"""A link that is late for a while, in a recorded flight: attitudes stay with their frames, no clock is called set."""

from functools import cache

import numpy as np
import pytest
import sample_edits
from places import REPOSITORY

from companion.core.core import Core
from companion.core.sync import Synchroniser
from companion.messages.messages import Estimate, Event
from companion.replay.source import PlainCamera, ReplaySource, open_source
from drivers.samples import Frame, Sample

SECONDS = 14.0
SET = {"clock_jumped", "clock_jump_taken_back", "autopilot_rebooted", "frames_jumped"}
LINKS = {
    "stalled, drains at 1.5": (sample_edits.drained(5, 0.6, 1.5), 5.0, 6.8),
    "stalled, drains at 1.2": (sample_edits.drained(5, 0.25, 1.2), 5.0, 6.5),
    "stalled, drains at 1.3": (sample_edits.drained(5, 0.4, 1.3), 5.0, 6.8),
    "0.15 s for 3 s": (sample_edits.stepped(6, 3, 0.15, 0.01), 6.0, 9.2),
    "0.12 s for 3 s": (sample_edits.stepped(6, 3, 0.12, 0.01), 6.0, 9.2),
    "0.3 s for 3 s, slowly": (sample_edits.stepped(6, 3, 0.3, 1.0), 6.0, 10.3),
    "0.15 s for 0.55 s": (sample_edits.stepped(8, 0.55, 0.15), 8.0, 8.7),
    "0.35 s for 0.55 s": (sample_edits.stepped(8, 0.55, 0.35), 8.0, 8.9),
    "bursts": (sample_edits.bursts(), 0.0, SECONDS),
}
"""Name -> lateness, and when it begins and is over."""


@cache
def agile() -> tuple[ReplaySource, tuple[Sample, ...]]:
    """The first seconds of a flight that turns quickly: what an attitude of another moment spoils most."""
    source = open_source(REPOSITORY / "sitl_logs" / "agile_a", None, (), PlainCamera())
    kept: list[Sample] = []
    for sample in source.samples():
        if kept and sample.arrival_us - kept[0].arrival_us > SECONDS * 1e6:
            break
        kept.append(sample)
    return source, tuple(kept)


def related(samples: list[Sample], monotonic: bool) -> tuple[dict[int, int], dict[int, float], list[str]]:
    """Boot time of every frame that has an attitude, doubt about it in us, and the names of the notices."""
    sync = Synchroniser(agile()[0].settings, True, monotonic)
    boot: dict[int, int] = {}
    doubt: dict[int, float] = {}
    names: list[str] = []
    for sample in samples:
        ready, notices = sync.feed(sample)
        names += [notice.name for notice in notices]
        for r in ready:
            if r.boot_us is not None and not isinstance(r.attitude, str):
                boot[r.frame.number], doubt[r.frame.number] = r.boot_us, sync.clock.std_s * 1e6
    return boot, doubt, names


@cache
def right_of(monotonic: bool) -> dict[int, int]:
    """Boot time of every frame over the link as it was."""
    return related(list(agile()[1]), monotonic)[0]


@pytest.mark.parametrize("monotonic", [False, True], ids=["replay", "live"])
@pytest.mark.parametrize("link", LINKS)
def test_attitudes_stay_with_their_frames(link: str, monotonic: bool) -> None:
    """Replay stamps arrivals by a clock that may be set, the live daemon by one that cannot."""
    _, samples = agile()
    late, begins_s, over_s = LINKS[link]
    right = right_of(monotonic)
    boot, doubt, names = related(sample_edits.slowed(samples, late), monotonic)
    assert not SET & set(names)
    assert len(boot) > (len(right) / 8 if link == "bursts" else len(right) * 0.8)
    off_us = {k: abs(boot[k] - right[k]) for k in boot.keys() & right.keys()}
    settled_s = 3.0 if link == "bursts" else 0.0
    start_us = min(s.stamp_us for s in samples if isinstance(s, Frame))
    when_s = {s.number: (s.stamp_us - start_us) * 1e-6 for s in samples if isinstance(s, Frame)}
    assert max(us for k, us in off_us.items() if when_s[k] >= settled_s) < 10_000
    assert all(us <= 4 * doubt[k] + 1000 for k, us in off_us.items())
    # the relation of before and after is that of the unedited flight
    assert all(us < 2000 for k, us in off_us.items() if when_s[k] < begins_s or when_s[k] > over_s + 1)
    if link != "bursts":
        after = [k for k in right if when_s[k] > over_s + 1 and when_s[k] < SECONDS - 0.5]
        assert all(k in boot for k in after)


def estimates(samples: list[Sample], monotonic: bool) -> tuple[dict[int, Estimate], list[str]]:
    source = agile()[0]
    core = Core(source.settings, source.camera, calibrated=True, telemetry=True, monotonic=monotonic)
    out = [o for sample in samples for o in core.feed(sample)]
    known = {o.frame: o for o in out if isinstance(o, Estimate) and o.inclination_deg is not None}
    return known, [o.event for o in out if isinstance(o, Event)]


def test_the_slope_of_before_comes_back_and_until_then_the_doubt_covers_the_error() -> None:
    """0.35 s for 0.55 s: this made 4.5 degrees of error at a sigma of 0.3 for the rest of the flight."""
    _, samples = agile()
    cut = [s for s in samples if s.arrival_us - samples[0].arrival_us < 6.0e6]
    right, _ = estimates(cut, False)
    found, names = estimates(sample_edits.slowed(cut, sample_edits.stepped(3.0, 0.55, 0.35)), False)
    assert not SET & set(names)
    first = min(right)
    off = np.array(
        [
            ((k - first) / 30, abs(found[k].inclination_deg - right[k].inclination_deg))
            for k in sorted(found.keys() & right.keys())
        ]
    )
    truth = np.genfromtxt(REPOSITORY / "sitl_logs" / "agile_a" / "truth.csv", delimiter=",", names=True)
    level = dict(zip(truth["frame"].astype(int).tolist(), truth["inclination_deg"].tolist(), strict=True))
    sigmas = [abs(e.inclination_deg - level[k]) / e.inclination_std_deg for k, e in found.items()]
    assert np.quantile(sigmas, 0.95) <= 3
    after = off[off[:, 0] > 4.4 - first / 30, 1]
    assert len(after) > 30
    assert after.max() <= 0.1
