"""What the autopilot says of itself, rule by rule: texts, status, radio and mode; times in seconds."""

import pytest

from companion.core.vehicle_state import CONFIRM_US, VehicleState
from drivers.samples import CurrentMode, Heartbeat, LandedState, Sample, StatusText, SystemStatus

ACTIVE, CALIBRATING, CRITICAL = 4, 2, 5


def beat(status: int = ACTIVE, mode: str = "GUIDED", kind: str = "quadrotor") -> Heartbeat:
    return Heartbeat(0, True, mode, "px4", status, kind)


def text(words: str) -> StatusText:
    return StatusText(0, 4, words)


def radio(present: bool, enabled: bool, healthy: bool) -> SystemStatus:
    return SystemStatus(0, present, enabled, healthy)


def after(*steps: tuple[float, Sample]) -> VehicleState:
    state = VehicleState()
    for at_s, sample in steps:
        state.feed(sample, round(at_s * 1e6))
    return state


LATER = CONFIRM_US * 1e-6 + 0.1


@pytest.mark.parametrize(
    ("steps", "failsafe"),
    [
        ((), None),
        (((0, beat()),), False),
        (((0, beat(CRITICAL)),), True),
        (((0, beat()), (0.1, text("EKF3 IMU0 origin set"))), False),
        (((0, beat()), (0.1, text("Fences enabled, but none selected"))), False),
        (((0, beat()), (0.1, text("Terrain breach ahead"))), False),
        (((0, beat()), (0.1, text("PrecLand: Failsafe Measures"))), False),
        (((0, beat()), (0.1, text("Circle fence breached"))), True),
        (((0, beat()), (0.1, text("Circle fence breached")), (0.2, text("Fence breach cleared"))), False),
        (((0, text("Battery Failsafe")), (0.5, beat())), True),
        (((0, text("Battery Failsafe")), (LATER, beat())), False),
        (((0, text("Battery Failsafe")), (LATER, beat(CALIBRATING))), True),
    ],
)
def test_a_failsafe_is_reported_by_status_and_text_and_ends_when_calm(steps, failsafe) -> None:
    assert after(*steps).failsafe is failsafe


@pytest.mark.parametrize(
    ("steps", "lost"),
    [
        ((), False),
        (((0, text("EKF3 IMU0 origin set")),), False),
        (((0, text("Manual control lost")),), True),
        (((0, text("Manual control lost")), (0.1, text("Manual control regained"))), False),
        (((0, radio(True, True, True)),), False),
        (((0, radio(True, True, False)),), True),
        # a receiver that was there and healthy and is gone; one that never was both
        (((0, radio(True, True, True)), (1, radio(False, False, False))), True),
        (((0, radio(False, False, False)),), False),
        (((0, radio(False, True, False)),), False),
        (((0, radio(True, False, False)),), False),
        (((0, radio(False, True, True)), (1, radio(False, False, False))), False),
        (((0, radio(True, False, True)), (1, radio(False, False, False))), False),
        (((0, radio(True, True, False)), (1, radio(False, False, False))), False),
    ],
)
def test_a_radio_is_lost_by_its_health_or_a_text(steps, lost) -> None:
    assert after(*steps).radio_lost is lost


def test_a_heartbeat_of_the_same_mode_leaves_what_was_intended() -> None:
    state = after((0, beat(mode="HOLD")), (0.1, CurrentMode(0, "HOLD", "POSCTL")), (0.2, beat(mode="HOLD")))
    assert not state.intended
    state.feed(beat(mode="POSCTL"), 300_000)
    assert state.intended


def test_a_vtol_hovers_when_the_landed_state_says_so() -> None:
    vtol = beat(kind="vtol_quadrotor")
    assert after((0, vtol)).kind == "vtol"
    assert after((0, vtol), (0.1, LandedState(0, "in_air", "fixed_wing"))).kind == "vtol"
    assert after((0, vtol), (0.1, LandedState(0, "in_air", "multicopter"))).kind == "vtol_hovering"
