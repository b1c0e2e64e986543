"""The landing procedure closed loop: over rubble it comes down on the even ground that it chose."""

from dataclasses import replace

from companion.simulation.ground import unsafe
from companion.simulation.lockstep import LockstepOptions, fly
from companion.simulation.procedure_figures import flown
from companion.simulation.scenario import read_scenario
from landing.decision.orders import OrderKind, State


def test_it_finds_even_ground_in_rubble_and_lands_on_it():
    scenario = read_scenario("clear_patch")
    camera = replace(scenario.camera, width_px=160, height_px=120, rate_hz=15.0)
    result = fly(replace(scenario, camera=camera), options=LockstepOptions())
    assert [s.step.order.kind for s in result.steps].count(OrderKind.LAND) == 1
    assert result.steps[-1].step.state is State.HAND_OVER
    assert result.touch_ground is not None
    assert not unsafe(result.touch_ground, result.limit_deg)
    figures = flown(result)
    assert figures.error_m < 0.3
    assert 0 <= figures.hand_over_m_s < 0.6
    assert figures.divergence_std < 0.08
    assert figures.seconds < 40
