"""Recorded flights under nuisances: errors within their stated sigma or a small bound, nothing unsafe called flat."""

from dataclasses import replace

import nuisances
import numpy as np
import pytest

from companion.core.core import Core
from companion.messages.messages import Event, Health
from drivers.samples import Attitude

SIGMAS = 3.0
BOUND_DEG = 1.0
NEARLY_ALL = 0.95
MOST_SILENT = 0.2

STAMPS = ("frames 20 ms late", "frames 20 ms early")
AT_THE_ATTITUDE = ("gyro bias of 1 deg/s", *STAMPS, "attitude at 10 Hz")
IN_THE_PICTURE = (
    "half without texture",
    "brightness steps of 30 %",
    "moving shadow",
    "propeller",
    "30 % outliers",
)
CASES = [
    *(("steep", nuisance) for nuisance in ("gyro bias of 1 deg/s", "attitude at 10 Hz", *IN_THE_PICTURE)),
    *(("agile", nuisance) for nuisance in (*AT_THE_ATTITUDE, "30 % outliers")),
    *(("stairs", nuisance) for nuisance in ("half without texture", "30 % outliers")),
    *(("descent", nuisance) for nuisance in ("half without texture", "attitude at 10 Hz")),
]


@pytest.mark.parametrize(("cut", "nuisance"), CASES, ids=lambda value: value.replace(" ", "_"))
def test_never_a_confident_wrong_answer(cut: str, nuisance: str):
    outcome = nuisances.run(cut, nuisance)
    # a single frame is no verdict: the dwell time stands before it
    assert outcome.unsafe_flat == 0
    assert outcome.unsafe > 0 or cut == "agile"
    counted = len(outcome.errors) + len(outcome.silent)
    assert counted >= 20
    assert len(outcome.silent) <= MOST_SILENT * counted, outcome.silent
    assert outcome.within(SIGMAS, BOUND_DEG) >= NEARLY_ALL
    if cut == "agile" and nuisance in STAMPS:
        # up to 60 deg/s for 20 ms: 1.2 degrees of attitude, until the pictures show it
        assert outcome.within(SIGMAS, 0.0) >= NEARLY_ALL
        assert float(np.quantile(outcome.errors, 0.95)) < 0.6


@pytest.mark.parametrize("cut", ["steep", "agile", "descent"])
def test_a_processor_with_a_quarter_of_its_speed_leaves_sigmas_right(cut: str):
    """Two of three frames are skipped, evenly: error over sigma is what it is with all of them (0.7 to 1.3)."""
    outcome = nuisances.run(cut, "a quarter of a core")
    assert 26 <= outcome.frames <= 40
    assert outcome.unsafe_flat == 0
    assert len(outcome.silent) <= MOST_SILENT * outcome.frames
    assert float(np.quantile(outcome.errors / outcome.stds, 0.95)) < 1.8
    assert outcome.within(SIGMAS, 0.0) == 1.0


def test_late_stamps_are_reported_of_once():
    source, samples = nuisances.cut("agile")
    late = nuisances.NUISANCES["frames 20 ms late"](list(samples))
    core = Core(source.settings, source.camera, calibrated=True, telemetry=True)
    out = [o for s in late for o in core.feed(s)] + core.finish()
    reported = [o for o in out if isinstance(o, Event) and o.event == "camera_late"]
    assert [e.details["late_s"] for e in reported] == pytest.approx([0.02], abs=0.004)
    assert "ms later than camera.time_offset_s = 0 s says" in reported[0].text
    health = [o for o in out if isinstance(o, Health)][-1]
    assert health.camera_late_s == pytest.approx(0.02, abs=4 * health.camera_late_std_s)
    assert health.camera_late_std_s < 0.002


def test_after_a_reboot_of_the_autopilot_the_time_offset_is_a_guess_again():
    source, samples = nuisances.cut("agile")
    half = len(samples) // 2
    # its boot time starts again at three seconds
    shift_us = next(s.boot_us for s in samples[half:] if isinstance(s, Attitude)) - 3_000_000
    again = [replace(s, boot_us=s.boot_us - shift_us) if hasattr(s, "boot_us") else s for s in samples[half:]]
    core = Core(source.settings, source.camera, calibrated=True, telemetry=True)
    std_s = []
    for sample in (*samples[:half], *again):
        std_s.append(core._pipeline.time_offset.std_s)
        if any(isinstance(o, Event) and o.event == "autopilot_rebooted" for o in core.feed(sample)):
            break
    assert std_s[-1] < 0.002
    assert core._pipeline.time_offset.std_s == source.settings.estimator.time_offset_std_s


def test_the_nuisances_are_felt():
    """They do change what the pipeline is given: none leaves the samples, or the estimates, as they were."""
    _, samples = nuisances.cut("steep")
    for name, edit in nuisances.NUISANCES.items():
        changed = edit(list(samples))
        if name not in ("nothing", "30 % outliers"):
            assert any(a is not b for a, b in zip(changed, samples, strict=False)), name
    frame = next(s.image for s in samples if hasattr(s, "image"))
    for change in (nuisances.shadow, nuisances.propeller):
        shares = [(change(k, frame) != frame).mean() for k in range(100)]
        assert 0.03 < max(shares) < 0.17
