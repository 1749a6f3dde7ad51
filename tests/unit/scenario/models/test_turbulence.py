"""The turbulence of gas that the wind of a scenario leads to, and that it forbids."""

import pytest

from gslcosim.base.errors import ScenarioError
from gslcosim.scenario import load_scenario
from gslcosim.scenario.loader import read_resolved
from gslcosim.scenario.serialization import dump_resolved

STILL = "wind={solver: uniform, inlet_velocity_m_s: [0, 0, 0]}"
UNIFORM = "wind={solver: uniform, inlet_velocity_m_s: [0, 0.4, 0]}"
SOLVED = "wind={solver: built_in, end_time_s: 5}"


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ([SOLVED], "wind"),
        (["wind={}"], "wind"),
        ([SOLVED, "wind.turbulence=rng_k_epsilon"], "wind"),
        ([SOLVED, "wind.turbulence=smagorinsky"], "none"),
        ([UNIFORM], "given"),
        ([STILL], "none"),
        ([SOLVED, "gas.turbulence.kind=none"], "none"),
        ([SOLVED, "gas.turbulence={kind: given, length_m: 0.5}"], "given"),
        ([UNIFORM, "gas.compatibility=gaden_2"], "none"),
        ([UNIFORM, "gas.compatibility=gaden_3", "gas.turbulence.kind=none"], "none"),
        ([SOLVED, "gas.growth_m2_s=0.002"], "none"),
        ([SOLVED, "gas.eddy_diffusivity_m2_s=0.002"], "none"),
        ([UNIFORM, "gas.model=farrell"], "none"),
    ],
)
def test_the_wind_chooses_the_turbulence_of_gas_unless_the_scenario_does(changes, kind):
    scenario = load_scenario("tiny_room", overrides=changes).scenario
    assert scenario.gas.turbulence.kind == kind
    assert (scenario.gas.eddies is None) == (kind == "none")
    assert scenario.gas.wall_images == (kind != "none")
    assert getattr(scenario.wind, "keep_turbulence", False) == (kind == "wind")
    again = read_resolved(dump_resolved(scenario), source="again")
    assert (again.gas, again.wind) == (scenario.gas, scenario.wind)


def test_images_at_walls_are_left_out_where_the_scenario_says_so():
    scenario = load_scenario("tiny_room", overrides=[UNIFORM, "gas.wall_images=false"]).scenario
    assert (scenario.gas.turbulence.kind, scenario.gas.wall_images) == ("given", False)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ([UNIFORM, "gas.turbulence.kind=wind"], "this wind has no k and epsilon, was wind. Solve it with wind:"),
        ([SOLVED, "wind.turbulence=laminar", "gas.turbulence.kind=wind"], "this wind has no k and epsilon"),
        ([STILL, "gas.turbulence.kind=given"], "a wind that blows with kind: given, was still air. Give wind.inlet"),
        ([SOLVED, "gas.turbulence={kind: none, length_m: 1}"], "no length_m with kind: none"),
        ([SOLVED, "gas.compatibility=gaden_3", "gas.turbulence={}"], "turbulence belongs to compatibility: none"),
    ],
)
def test_turbulence_that_the_wind_cannot_have_is_refused(changes, sentence):
    with pytest.raises(ScenarioError) as refusal:
        load_scenario("tiny_room", overrides=changes)
    assert sentence in str(refusal.value)
