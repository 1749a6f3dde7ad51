"""`random` in a scenario: drawn from its seed, in air, where vehicles can stand; refused where nothing can be drawn."""

import pytest
import yaml

from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Cell
from gslcosim.environment.positions import draw_positions, find_position_problems
from gslcosim.environment.vertical_clearance import clear_height_m
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.problems import InvalidScenarioError

AGENT = {
    "start": {"attach": True}, "vehicle": {"start_m": "random"}, "sensors": [{"model": "tgs2600", "name": "nose"}]
}  # fmt: skip
SCENARIO = {
    "schema": "gslcosim/scenario/1", "name": "lot", "seed": 3,
    "environment": {"layout": {"kind": "warehouse_simple"}}, "wind": {"solver": "uniform"},
    "gas": {"sources": [{"position_m": "random"}, {"position_m": [5, 1, 2]}]},
    "agents": [{"name": name, **AGENT} for name in ("one", "two")],
}  # fmt: skip


@pytest.fixture
def load(tmp_path):
    def load(**changes):
        path = tmp_path / "lot.yaml"
        seed = changes.pop("seed", None)
        path.write_text(yaml.safe_dump({**SCENARIO, **changes}))
        return load_scenario(path, seed=seed, placer=draw_positions).scenario

    return load


def test_random_places_are_air_and_starts(load):
    for seed in range(5):
        scenario = load(seed=seed)
        room = build_geometry(scenario.environment, scenario.wind)
        source_m = scenario.gas.sources[0].position_m
        cell = tuple(room.grid.cell_of(source_m))
        assert room.occupancy[cell] != Cell.SOLID
        assert 0.5 <= source_m[2] <= 3.0
        assert find_position_problems(scenario) == []


def test_places_follow_the_seed_and_nothing_else(load):
    def places(scenario):
        return [source.position_m for source in scenario.gas.sources] + [a.vehicle.start_m for a in scenario.agents]

    assert places(load()) == places(load())
    assert places(load()) != places(load(seed=4))
    assert places(load())[1] == (5.0, 1.0, 2.0)
    # A further random start leaves the others where they are.
    alone = load(agents=SCENARIO["agents"][:1])
    assert places(alone)[:3] == places(load())[:3]


@pytest.mark.parametrize(
    "wind",
    [
        {"solver": "built_in", "end_time_s": 4.0, "save_every_s": 1.0},
        {"inlet_profile": "parabolic"},
        {"solver": "openfoam", "end_time_s": 50},
    ],
    ids=lambda wind: "_".join(wind),
)
def test_settings_of_the_wind_do_not_keep_places_from_being_drawn(load, wind):
    assert find_position_problems(load(wind=wind)) == []


def test_a_room_with_problems_is_reported_and_its_random_places_with_it(load):
    with pytest.raises(InvalidScenarioError) as caught:
        load(environment={"layout": {"kind": "warehouse_simple", "size_m": [15.03, 15, 8]}})
    paths = [located.problem.where for located in caught.value.problems]
    assert "gas.sources[0].position_m" in paths


def test_without_a_room_at_hand_random_is_refused(tmp_path):
    path = tmp_path / "lot.yaml"
    path.write_text(yaml.safe_dump(SCENARIO))
    with pytest.raises(InvalidScenarioError, match="random"):
        load_scenario(path)


@pytest.mark.parametrize(
    ("changes", "path"),
    [
        ({"environment": {"layout": {"kind": "warehouse_simple", "size_m": [15, 15]}}}, "environment.layout.size_m"),
        ({"vehicle": {"start_m": "random", "hold_s": -1}}, "agents[0].vehicle.hold_s"),
        (
            {"vehicle": {"start_m": "random", "model": "rover", "search_height_m": 2}},
            "agents[0].vehicle.search_height_m",
        ),
    ],
    ids=["room", "number", "between numbers"],
)
def test_what_keeps_places_from_being_drawn_is_reported_and_not_what_follows_from_it(load, changes, path):
    if "vehicle" in changes:
        changes = {"agents": [{**SCENARIO["agents"][0], **changes}]}
    with pytest.raises(InvalidScenarioError) as caught:
        load(**changes)
    assert [located.problem.where for located in caught.value.problems] == [path]


# A closet in a small hall: its door lets air through, and an Iris not.
CLOSET = {
    "layout": {
        "kind": "warehouse_empty", "size_m": [6, 6, 3], "inlet_size_m": [1, 1], "outlet_size_m": [1, 1],
        "obstacles": [
            {"name": "north", "min_m": [1.5, 4.4, 0], "max_m": [4.5, 4.5, 3]},
            {"name": "south", "min_m": [1.5, 1.5, 0], "max_m": [4.5, 1.6, 3]},
            {"name": "east", "min_m": [4.4, 1.5, 0], "max_m": [4.5, 4.5, 3]},
            {"name": "west", "min_m": [1.5, 1.5, 0], "max_m": [1.6, 4.0, 3]},
        ],
    }
}  # fmt: skip


@pytest.mark.parametrize("avoidance", ["none", "2d", "3d"])
def test_a_vehicle_that_plans_its_way_does_not_start_where_there_is_none(load, avoidance):
    def is_in_closet(seed):
        vehicle = {"start_m": "random", "search_height_m": 1.0, "avoidance": avoidance}
        agent = {**SCENARIO["agents"][0], "vehicle": vehicle}
        gas = {"sources": [{"position_m": [5.5, 5.5, 1]}]}
        scenario = load(
            seed=seed, environment=CLOSET, gas=gas, agents=[agent], wind={"solver": "uniform", "cell_m": 0.1}
        )
        x_m, y_m, _ = scenario.agents[0].vehicle.start_m
        return 1.5 < x_m < 4.5 and 1.5 < y_m < 4.5

    n_in_closet = sum(is_in_closet(seed) for seed in range(12))
    assert (n_in_closet > 0) is (avoidance == "none")


def test_no_start_is_so_near_a_wall_that_its_cells_keep_the_vehicle_on_the_ground(load):
    walls = [
        {"name": f"wall_{i}", "min_m": [0.55 + i, 0.0, 0.0], "max_m": [0.6 + i, 3.0, 3.0]} for i in range(5)
    ]  # fmt: skip
    environment = {
        "layout": {
            "kind": "warehouse_empty", "size_m": [6, 6, 3], "inlet_size_m": [1, 1], "outlet_size_m": [1, 1],
            "obstacles": walls,
        }
    }  # fmt: skip
    vehicle = {"model": "holonomic", "start_m": "random", "search_height_m": 1.5, "avoidance": "2d"}
    agents = [{**SCENARIO["agents"][0], "vehicle": vehicle}]
    gas = {"sources": [{"position_m": [5.5, 5.5, 1]}]}
    for seed in range(20):
        scenario = load(seed=seed, environment=environment, gas=gas, agents=agents, wind={"solver": "uniform"})
        room = build_geometry(scenario.environment, scenario.wind)
        spec = scenario.agents[0].vehicle
        assert clear_height_m(room, spec.facts.body.radius_m, spec.start_m, 1.5) == 1.5
