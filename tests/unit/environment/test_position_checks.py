"""Places of sources and vehicles: what is refused, why, and which place is offered instead."""

import numpy as np
import pytest
from built_scenarios import build_agent, build_scenario

from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell, WindFrames, with_wind
from gslcosim.environment.positions import find_position_problems, find_position_problems_in, nearest_free_point_m
from gslcosim.environment.store import save_environment
from gslcosim.scenario.models.scenario import Scenario

SHELF = {"name": "shelf", "min_m": [4.0, 2.0, 0.0], "max_m": [6.0, 3.0, 2.0]}


def scenario(*starts_m, sources=((2.0, 2.0, 2.0),), obstacles=(SHELF,), search_height_m=2.0, environment=None):
    agents = [
        build_agent(f"agent_{i}", start_m, vehicle={"search_height_m": search_height_m})
        for i, start_m in enumerate(starts_m or ((10.0, 8.0, 0.2),))
    ]
    return build_scenario(
        *agents,
        environment=environment or {"layout": {"size_m": [12.0, 10.0, 5.0], "obstacles": list(obstacles)}},
        gas={"sources": [{"position_m": position_m} for position_m in sources]},
    )


def only_problem(*args, **changes):
    (problem,) = find_position_problems(scenario(*args, **changes))
    return problem


def offered(problem):
    """The point in a remedy such as `Nearest free point: [1, 2, 3].`"""
    return tuple(float(number) for number in problem.remedy.split("[")[1].split("]")[0].split(","))


@pytest.mark.parametrize(
    "starts_m",
    [((10.0, 8.0, 0.2), (9.0, 8.0, 0.0)), ((6.38, 2.5, 0.2), (0.38, 5.0, 0.2)), ((5.0, 2.5, 2.0),)],
    ids=["far apart", "a radius from shelf and wall", "on the shelf"],
)
def test_good_starts_have_no_problems(starts_m):
    assert find_position_problems(scenario(*starts_m)) == []


def test_a_source_in_an_obstacle_is_refused_with_the_nearest_free_point():
    problem = only_problem(sources=((2.0, 2.0, 2.0), (5.0, 2.9, 1.0)))
    assert problem.where == "gas.sources[1].position_m"
    assert problem.found == "[5, 2.9, 1], inside shelf"
    assert offered(problem) == pytest.approx((5.1, 3.1, 1.1), abs=0.21)


@pytest.mark.parametrize("position_m", [(-0.1, 5.0, 1.0), (12.0, 5.0, 1.0), (2.0, 30.0, 1.0), (2.0, 5.0, -2.0)])
def test_a_source_outside_the_room_is_refused_with_the_nearest_free_point(position_m):
    problem = only_problem(sources=(position_m,))
    assert "outside the room, which reaches from [0, 0, 0] to [12, 10, 5] m" in problem.found
    inside = np.clip(position_m, 0.0, (12.0, 10.0, 5.0))
    assert np.linalg.norm(np.subtract(offered(problem), inside)) <= 0.2


def test_a_probe_in_an_obstacle_or_outside_is_refused_with_the_nearest_free_point():
    places_m = ((3.0, 2.5, 1.0), (5.0, 2.9, 1.0), (2.0, 5.0, 5.5))
    probes = [{"name": f"probe_{i}", "position_m": position_m} for i, position_m in enumerate(places_m)]
    plain = scenario().model_dump(by_alias=True, exclude_unset=True)
    solid, outside = find_position_problems(Scenario.model_validate({**plain, "probes": probes}))
    assert solid.where == "probes[1].position_m"
    assert (solid.expected, solid.found) == ("a point in the room's air", "[5, 2.9, 1], inside shelf")
    assert offered(solid) == pytest.approx((5.1, 3.1, 1.1), abs=0.21)
    assert (outside.where, outside.found[:14]) == ("probes[2].position_m", "[2, 5, 5.5], o")


def test_a_source_in_a_sealed_pocket_is_refused():
    walls = [
        {"name": "a", "min_m": [4, 4, 0], "max_m": [6, 4.2, 5]},
        {"name": "b", "min_m": [4, 5.8, 0], "max_m": [6, 6, 5]},
        {"name": "c", "min_m": [4, 4.2, 0], "max_m": [4.2, 5.8, 5]},
        {"name": "d", "min_m": [5.8, 4.2, 0], "max_m": [6, 5.8, 5]},
    ]  # fmt: skip
    problem = only_problem(sources=((5.0, 5.0, 2.0),), obstacles=walls)
    assert problem.found == "[5, 5, 2], inside a solid cell"


def test_the_nearest_free_point_is_the_nearest_of_all_air_cells():
    room = build_layout(scenario().environment.layout, scenario().wind)
    centres = room.grid.centres_m()[room.occupancy != Cell.SOLID]
    rng = np.random.default_rng(3)
    for _ in range(30):
        position = rng.random(3) * (20.0, 18.0, 12.0) - 4.0
        expected = np.linalg.norm(centres - position, axis=1).min()
        assert np.linalg.norm(np.subtract(nearest_free_point_m(tuple(position), room), position)) == pytest.approx(
            expected, abs=1e-5
        )


@pytest.mark.parametrize(
    ("start_m", "expected", "found"),
    [
        ((5.0, 2.5, 0.2), "a point in the room's air", "[5, 2.5, 0.2], inside shelf"),
        ((6.3, 2.5, 0.2), "0.38 m of free space", "[6.3, 2.5, 0.2], shelf in it"),
        ((10.0, 0.3, 0.2), "0.38 m of free space", "[10, 0.3, 0.2], wall_y_min in it"),
        ((50.0, 50.0, 0.2), "a point in the room's air", "[50, 50, 0.2], outside the room"),
    ],
)
def test_a_start_that_is_not_free_is_refused_with_one_that_is(start_m, expected, found):
    problem = only_problem(start_m)
    assert problem.where == "agents[0].vehicle.start_m"
    assert problem.found.startswith(found)
    assert expected in problem.expected
    assert find_position_problems(scenario(offered(problem))) == []


def test_a_start_under_something_is_refused_when_the_vehicle_must_rise_through_it():
    table = {"name": "table", "min_m": [7.0, 5.0, 1.0], "max_m": [9.0, 7.0, 1.2]}
    assert only_problem((8.0, 6.0, 0.2), obstacles=[table]).found == "[8, 6, 0.2], table in it"
    assert find_position_problems(scenario((8.0, 6.0, 0.2), obstacles=[table], search_height_m=0.5)) == []


@pytest.mark.parametrize(
    ("height_m", "is_allowed"), [(9.0, False), (4.8, False), (4.6, True), (0.4, True), (0.2, False)]
)
def test_search_heights_keep_the_vehicles_radius_from_floor_and_ceiling(height_m, is_allowed):
    problems = find_position_problems(scenario(search_height_m=height_m))
    assert [p.where for p in problems] == ([] if is_allowed else ["agents[0].vehicle.search_height_m"])
    assert all("ceiling is at 5 m" in p.expected and p.found == f"{height_m:g} m" for p in problems)


def test_vehicles_that_start_in_each_other_are_refused():
    problem = only_problem((10.0, 8.0, 0.2), (10.5, 8.0, 0.2))
    assert problem.where == "agents[1].vehicle.start_m"
    assert problem.found == "[10.5, 8, 0.2], which is 0.5 m from it"
    assert problem.remedy == "Move it 0.26 m further away."


def test_all_problems_of_all_places_are_reported():
    bad = scenario((5.0, 2.5, 0.2), (50.0, 8.0, 0.2), sources=((5.0, 2.5, 1.0), (-1.0, 0.0, 0.0)), search_height_m=9.0)
    assert [problem.where for problem in find_position_problems(bad)] == [
        "gas.sources[0].position_m",
        "gas.sources[1].position_m",
        "agents[0].vehicle.search_height_m",
        "agents[0].vehicle.start_m",
        "agents[1].vehicle.search_height_m",
        "agents[1].vehicle.start_m",
    ]


def test_problems_of_the_room_come_before_those_of_its_places():
    problems = find_position_problems(scenario((50.0, 8.0, 0.2), environment={"layout": {"size_m": [15.1, 15, 8]}}))
    assert [problem.where for problem in problems] == ["environment.layout.size_m[0]"]


def test_places_in_a_saved_environment_are_checked_the_same_way(tmp_path):
    generated = scenario((5.0, 2.5, 0.2), sources=((5.0, 2.5, 1.0),))
    room = build_layout(generated.environment.layout, generated.wind)
    still = WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), dtype=np.float32))
    save_environment(with_wind(room, still), tmp_path / "room")
    stored = scenario((5.0, 2.5, 0.2), sources=((5.0, 2.5, 1.0),), environment={"path": "room"})
    assert find_position_problems(stored, scenario_dir=tmp_path) == find_position_problems(generated)
    assert find_position_problems_in(stored, with_wind(room, still)) == find_position_problems(generated)


def test_a_missing_environment_folder_is_a_problem_of_its_path(tmp_path):
    (problem,) = find_position_problems(scenario(environment={"path": "nowhere"}), scenario_dir=tmp_path)
    assert (problem.where, problem.found) == ("environment.path", "nowhere")
    assert "no such folder" in problem.remedy
