"""A processor that is too slow is a condition with what would help, and frames are skipped evenly."""

from itertools import pairwise

from companion.live.overload import ENDS, WINDOW_US, Overload
from companion.messages.conditions import Condition

FRAME_US = 1_000_000 // 30


def flown(
    cost_us: int, seconds: int, overload: Overload, start_us: int = 0
) -> tuple[list[Condition | None], list[int]]:
    """A camera at 30 Hz whose newest frame waits, and a processor that needs ``cost_us`` for each.

    Returns the conditions, one a frame processed, and the numbers of those frames.
    """
    found, processed, now_us = [], [], start_us
    newest = -1
    while now_us < start_us + seconds * 1_000_000:
        frame = (now_us - start_us) // FRAME_US
        if frame == newest:
            now_us = start_us + (frame + 1) * FRAME_US
            continue
        newest = frame
        processed.append(frame)
        found.append(overload.step(now_us, len(processed), frame + 1 - len(processed)))
        now_us += cost_us
    return found, processed


def test_a_processor_that_keeps_up_is_no_condition():
    found, _ = flown(8_000, 20, Overload())
    assert set(found) == {None}


def test_a_quarter_of_that_speed_is_a_condition_that_says_what_would_help():
    found, processed = flown(4 * 25_000, 20, Overload())
    stands = [c for c in found if c is not None]
    assert found[-1] is not None
    assert stands[-1].code == "overloaded"
    assert "10 of 30 frames a second" in stands[-1].text
    for remedy in ("camera.rate_hz", "camera.width", "tracking.max_features"):
        assert remedy in stands[-1].text
    gaps = {later - earlier for earlier, later in pairwise(processed)}
    assert max(gaps) - min(gaps) <= 1, "skipped evenly"


def test_it_ends_when_the_processor_keeps_up_again():
    overload, first_us = Overload(), 0
    counted = [0, 0]
    states = []
    for second in range(40):
        slow = 5 <= second < 20
        counted[0] += 15 if slow else 30
        counted[1] += 15 if slow else 0
        states.append(overload.step(first_us + second * 1_000_000, *counted) is not None)
    assert not any(states[:6])
    assert all(states[10:20])
    assert not any(states[20 + WINDOW_US // 1_000_000 + 1 :])


def test_a_single_late_frame_and_a_camera_that_counts_anew_are_none():
    overload = Overload()
    assert all(overload.step(k * 1_000_000, 30 * k, k // 10) is None for k in range(30))
    assert overload.step(30_000_000, 3, 0) is None
    assert 0 < ENDS < 0.1
