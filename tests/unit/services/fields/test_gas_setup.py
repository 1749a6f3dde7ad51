import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim_services.fields.gas_setup import gas_timing


def timed(make_scenario, **gas):
    scenario = make_scenario()
    return gas_timing(scenario.model_copy(update={"gas": scenario.gas.model_copy(update=gas)}))


@pytest.mark.parametrize(
    ("step_s", "steps_at"), [(0.1, [0, 1, 1, 1, 1, 1]), (0.02, [0, 5, 5, 5, 5, 5]), (0.3, [0, 0, 0, 1, 0, 0])]
)
def test_gas_steps_fit_into_ticks(make_scenario, step_s, steps_at):
    timing = timed(make_scenario, step_s=step_s, warm_up_s=150.0)
    assert [timing.steps_at(tick) for tick in range(6)] == steps_at
    assert timing.warm_up_steps * timing.step_s == pytest.approx(150.0)


def test_no_warm_up_is_no_step(make_scenario):
    assert timed(make_scenario, step_s=0.1, warm_up_s=0.0).warm_up_steps == 0


@pytest.mark.parametrize(
    ("step_s", "warm_up_s", "problem"),
    [
        (0.03, 0.0, r"gas\.step_s: expected .* tick of 0\.1 s, was 0\.03 s"),
        (0.3, 100.0, r"gas\.warm_up_s: .* was 100 s\. Nearest: 99\.9 s or 100\.2 s"),
    ],
)
def test_times_that_do_not_fit_are_refused(make_scenario, step_s, warm_up_s, problem):
    with pytest.raises(ScenarioError, match=problem):
        timed(make_scenario, step_s=step_s, warm_up_s=warm_up_s)
