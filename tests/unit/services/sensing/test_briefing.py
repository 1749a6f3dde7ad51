import math

import numpy as np
import pytest
from built_scenarios import build_agent, build_scenario

from gslcosim.contract.messages import KnownMap, Task
from gslcosim.scenario.models.gas import GasSpec
from gslcosim.scenario.models.scenario import RefereeSpec
from gslcosim_services.sensing.briefing import build_briefing, build_known_map, build_nominal_plume, build_task

PILLAR = ("pillar", (3.0, 2.0, 0.0), (4.0, 3.0, 1.0))


@pytest.fixture
def scenario_with():
    """Build a scenario whose one agent is granted knowledge and has parameters."""

    def build(knows, **agent):
        agent = build_agent("agent_0", **{"vehicle": {"hold_s": 0.5, "search_height_m": 0.5}, "knows": knows, **agent})
        return build_scenario(agent, wind={"solver": "uniform", "inlet_velocity_m_s": [0.3, 0.4, 0]})

    return build


@pytest.mark.parametrize(
    ("success", "expected"),
    [
        ({"horizontal": True}, {"goal": "source", "distance_of": "vehicle", "is_horizontal": True}),
        ({"of": "declaration"}, {"goal": "declaration", "distance_of": "declaration", "asks_for_declaration": True}),
        ({"of": "all_sources"}, {"goal": "all_sources", "distance_of": "vehicle", "n_sources": None}),
        ({"of": "map", "mass_at_least": 0.8}, {"goal": "map", "distance_of": "belief", "mass_at_least": 0.8}),
    ],
    ids=lambda item: item.get("of", item.get("goal")),
)
def test_the_task_has_what_the_criterion_asks_for_and_the_limits(success, expected):
    referee = RefereeSpec.model_validate({"success": {"within_m": 0.5, **success}, "stop": {"time_limit_s": 90.0}})
    assert build_task(referee) == Task(success_radius_m=0.5, time_limit_s=90.0, **expected)


def test_no_knowledge_is_given_that_is_not_granted(make_room, scenario_with):
    scenario = scenario_with({})
    briefing = build_briefing(scenario.agents[0], scenario, make_room(), seed=1)
    assert (briefing.known_map, briefing.plume, briefing.known_sources, briefing.parameters) == (None, None, (), {})


def test_the_map_is_cut_at_the_search_height(make_room, scenario_with):
    room = make_room(obstacles=[PILLAR])
    low = build_known_map(scenario_with({"map": True}).agents[0], room)
    assert isinstance(low, KnownMap)
    assert (low.occupied.shape, low.height_m, low.cell_m, low.origin_m) == ((60, 40), 0.5, 0.25, (0.0, 0.0, 0.5))
    expected = np.zeros((60, 40), np.uint8)
    expected[12:16, 8:12] = 1
    assert np.array_equal(low.occupied.to_array(), expected)
    above = {"search_height_m": 2.0, "start_m": [5, 1, 0.2]}
    assert not build_known_map(scenario_with({"map": "2d"}, vehicle=above).agents[0], room).occupied.to_array().any()


def test_the_map_in_space_has_all_layers(make_room, scenario_with):
    room = make_room(obstacles=[PILLAR])
    whole = build_known_map(scenario_with({"map": "3d"}).agents[0], room)
    assert (whole.occupied.shape, whole.height_m) == ((60, 40, 24), None)
    assert whole.occupied.to_array().sum() == 4 * 4 * 4


def test_the_nominal_plume_holds_the_amount_of_its_filaments(scenario_with):
    """The integral of a Gaussian with 10 ppm in its centre and 0.1 m, ten times a second."""
    plume = build_nominal_plume(scenario_with({"plume": True}))
    x_m = np.linspace(-1.0, 1.0, 81)
    one_axis = np.exp(-(x_m**2) / (2 * 0.1**2)).sum() * (x_m[1] - x_m[0])
    assert plume.release_ppm_m3_s == pytest.approx(10 * 10 * one_axis**3, rel=1e-6)
    assert plume.wind_speed_m_s == pytest.approx(math.hypot(0.3, 0.4))


def test_a_plume_without_filaments_is_reported_with_the_spread_of_usual_ones(scenario_with):
    scenario = scenario_with({"plume": True})
    gas = GasSpec(model="formula", sources=scenario.gas.sources)
    assert build_nominal_plume(scenario.model_copy(update={"gas": gas})) == build_nominal_plume(scenario)


def test_sources_and_parameters_come_as_the_scenario_has_them(make_room, scenario_with):
    scenario = scenario_with({"source": True}, parameters={"step_m": 0.5, "sides": ["left", 2]})
    briefing = build_briefing(scenario.agents[0], scenario, make_room(), seed=1)
    assert briefing.known_sources == ((5.0, 1.0, 2.0),)
    assert briefing.parameters == {"step_m": 0.5, "sides": ("left", 2)}


def test_a_source_of_another_gas_is_not_among_the_known_ones(make_room, scenario_with):
    scenario = scenario_with({"source": True, "plume": True})
    (source,) = scenario.gas.sources
    decoy = source.model_copy(update={"position_m": (9.0, 8.0, 2.0), "gas": "methane", "ppm": 99.0})
    both = scenario.model_copy(update={"gas": scenario.gas.model_copy(update={"sources": (decoy, source)})})
    briefing = build_briefing(both.agents[0], both, make_room(), seed=1)
    assert briefing.known_sources == (source.position_m,)
    assert briefing.plume == build_nominal_plume(scenario)
