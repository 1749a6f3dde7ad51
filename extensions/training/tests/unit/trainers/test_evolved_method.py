"""Evolution of a method's parameters: within their ranges, from the defaults on; wrong settings are reported."""

import numpy as np
import pytest

from gslcosim.base.bundled import bundled_agents
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.methods.card import find_card_beside
from gslcosim_training.family import load_family
from gslcosim_training.trainers.evolution import EvolvedMethod, compute_cost
from gslcosim_training.trainers.trainer import MethodSettings

SWARM = {"method": "s_pso", "robots": 3, "ranges": {"inertia": (0.0, 1.0), "leg_m": (0.3, 4.0)}}


@pytest.fixture(scope="module")
def cases():
    return load_family("open_halls").cases("training", 1)


def trainer(cases, **settings):
    method_settings = MethodSettings(kind="method", **{**SWARM, "rounds": 2, "population": 4, **settings})
    return EvolvedMethod("open_halls", cases, settings=method_settings, seed=1, weights=lambda costs: np.ones(1))


def test_it_begins_at_the_methods_own_defaults(cases):
    defaults = find_card_beside(bundled_agents()["s_pso"]).defaults()
    begun = trainer(cases).policy()
    assert begun.parameters == {name: pytest.approx(defaults[name], rel=1e-3) for name in SWARM["ranges"]}
    assert (begun.entry.robots, begun.entry.start.python) == (3, "s_pso")


def test_every_individual_is_within_its_ranges_and_whole_where_the_card_says_so(cases):
    ranges = {"inertia": (0.2, 0.7), "patience": (3.0, 9.0)}
    evolved = trainer(cases, method="dr_pso", ranges=ranges, spread=5.0, population=50)
    for genome in evolved._evolution.ask():
        parameters = evolved._with(genome).parameters
        assert all(low <= parameters[name] <= high for name, (low, high) in ranges.items())
        assert isinstance(parameters["patience"], int)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"method": "s_psu"}, r"trainer\.method: expected a bundled method, was 's_psu'"),
        ({"ranges": {}}, r"trainer\.ranges: expected at least one parameter"),
        (
            {"ranges": {"inertia": (0.7, 0.7)}},
            r"trainer\.ranges\.inertia: expected least below most, was 0\.7 and 0\.7",
        ),
        ({"ranges": {"inertia": (0.0, 1.5)}}, r"trainer\.ranges\.inertia: expected at most 1, was 1\.5"),
        ({"ranges": {"inertla": (0.0, 1.0)}}, r"trainer\.ranges\.inertla: expected a parameter of S-PSO.*mean inertia"),
        ({"ranges": {"declares": (0.0, 1.0)}}, r"trainer\.ranges\.declares: expected true or false"),
        ({"robots": 1}, r"trainer\.robots: expected 3 to 10 for s_pso, was 1"),
        ({"method": "e_coli", "ranges": {"leg_m": (0.3, 1.0)}}, r"trainer\.robots: expected 1 for e_coli, was 3"),
    ],
)
def test_wrong_settings_are_reported_by_their_places(cases, settings, expected):
    with pytest.raises(UsageError, match=expected):
        trainer(cases, **settings)


def test_sensors_that_the_family_lacks_are_reported_before_anything_is_run(cases):
    with pytest.raises(ScenarioError, match=r"agents\[0\]\.sensors: expected at least 1 of kind range for Sniffy Bug"):
        trainer(cases, method="sniffy_bug", ranges={"speed_m_s": (0.2, 1.0)})


def test_a_success_costs_its_time_and_a_failure_what_is_left_of_the_way():
    row = {"success": True, "time_s": 45.0, "time_limit_s": 180.0}
    assert compute_cost(row) == 0.25
    place = {"start_x_m": 0.0, "start_y_m": 0.0, "source_x_m": 3.0, "source_y_m": 4.0}
    assert compute_cost({"success": False, "nearest_m": 2.0, **place}) == pytest.approx(1.4)
    assert compute_cost({"success": False, "nearest_m": 9.0, **place}) == 2.0
    assert compute_cost({"success": False, "nearest_m": None, **place}) == 2.0
