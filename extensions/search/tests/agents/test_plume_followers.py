"""Agents that go up a plume, and look for it again where they have lost it."""

import itertools
import math

import pytest
from ribbon_world import Ribbon, fly
from stops_in_wind import START_M, WEST_RAD, at, flown, made

from gslcosim_agents.casting.agent import Casting
from gslcosim_agents.moth_inspired.agent import MothInspired
from gslcosim_agents.q_memory.agent import QMemory
from gslcosim_agents.surge_cast.agent import SurgeCast
from gslcosim_agents.surge_cast_3d.agent import SurgeCast3d
from gslcosim_agents.surge_spiral.agent import SurgeSpiral

STRAIGHT, WINDING, BLOBS = Ribbon(), Ribbon(wave_m=1.0), Ribbon(wave_m=0.8, blob_m=0.6, gap_m=1.0)
PLUMES = {
    Casting: (STRAIGHT, WINDING),
    MothInspired: (STRAIGHT,),
    QMemory: (WINDING, BLOBS),
    SurgeCast: (STRAIGHT, WINDING, BLOBS),
    SurgeCast3d: (WINDING,),
    SurgeSpiral: (STRAIGHT, WINDING),
}
# Each nose in the first plume, and one of them in the others.
FLIGHTS = [(agent, nose, plumes[0]) for agent, plumes in PLUMES.items() for nose in ("pid", "binary", "tgs2600")]
FLIGHTS += [(agent, "pid", plume) for agent, plumes in PLUMES.items() for plume in plumes[1:]]


@pytest.mark.parametrize(("agent_type", "nose", "plume"), FLIGHTS)
def test_it_comes_up_a_ribbon_of_gas(agent_type, nose, plume):
    assert fly(agent_type, plume, nose=nose, limit_s=150.0).found_s is not None


@pytest.mark.parametrize("agent_type", [Casting, MothInspired, SurgeCast, SurgeSpiral])
def test_other_seeds_give_other_sides(agent_type):
    lost = [1.0, 0.0, 0.0, 0.0, 0.0]
    assert len({tuple(flown(made(agent_type, seed=seed), lost)) for seed in range(10)}) > 1


@pytest.mark.parametrize("agent_type", [Casting, MothInspired, SurgeCast])
def test_it_declares_near_the_source_and_not_where_it_may_not(agent_type):
    def declared(**parameters):
        flight = fly(agent_type, STRAIGHT, found_m=0.0, limit_s=260.0, parameters=parameters)
        return [command.declaration for command in flight.commands if command.declaration is not None]

    (first, *_) = declared()
    assert math.dist(first.position_world_m, (2.0, 5.0, 2.0)) < 0.6
    assert declared(declares=False) == []


@pytest.mark.parametrize("agent_type", [SurgeCast, SurgeSpiral])
def test_gas_sends_it_a_step_upwind(agent_type):
    assert flown(made(agent_type), [1.0, 1.0]) == [(6.0, 5.0, 2.0), (5.0, 5.0, 2.0)]


def test_it_goes_on_upwind_until_the_plume_counts_as_lost_and_then_casts_d_2d_3d_across():
    places = flown(made(SurgeCast, parameters={"lost_m": 1.5}), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    assert places[:2] == [(6.0, 5.0, 2.0), (5.5, 5.0, 2.0)]
    turns_m = [y_m - 5.0 for _, y_m, _ in places[2:6]]
    side = math.copysign(1.0, turns_m[0])
    assert turns_m == pytest.approx([side * 0.75, -side * 0.75, side * 1.5, -side * 1.5])
    assert all(x_m == 5.5 for x_m, _, _ in places[2:6])


def test_a_cast_keeps_the_wind_with_which_it_began():
    agent = made(SurgeCast, parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    first = agent.decide(at(80, (6.0, 5.0, 2.0)))
    second = agent.decide(at(120, first.position_world_m, upwind_rad=0.5))
    assert first.position_world_m[0] == second.position_world_m[0] == 6.0


def test_gas_on_the_way_is_gone_back_to_sideways():
    agent = made(SurgeCast, parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    agent.decide(at(80, (6.0, 5.0, 2.0)))
    agent.observe(at(90, (6.0, 5.4, 2.0), ppm=1.0, status="flying"))
    assert agent.decide(at(120, (6.0, 5.75, 2.0))).position_world_m == (5.0, 5.4, 2.0)


def test_the_last_blank_decides_how_long_it_waits():
    agent = made(SurgeCast, parameters={"lost_by": "last_blank", "least_memory_s": 1.0})
    agent.observe(at(10, ppm=1.0))
    agent.observe(at(60, ppm=1.0))  # a blank of 5 s
    agent.decide(at(70))
    assert agent.decide(at(100, (6.0, 5.0, 2.0))).position_world_m == (5.0, 5.0, 2.0)
    x_m, y_m, _ = agent.decide(at(120, (5.0, 5.0, 2.0))).position_world_m
    assert (x_m, abs(y_m - 5.0)) == (5.0, 0.75)


def test_it_may_explore_at_random_nearby():
    (place_m,) = flown(made(SurgeCast, parameters={"explore": "random"}), [0.0])
    assert max(abs(place_m[0] - 7.0), abs(place_m[1] - 5.0)) <= 0.5


def test_asked_at_every_tick_it_lets_a_leg_end_but_breaks_off_a_cast_for_gas():
    agent = made(SurgeCast, mode="lockstep", parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    assert agent.decide(at(45, (6.5, 5.0, 2.0), status="flying")).kind == "noop"
    agent.decide(at(46, (6.0, 5.0, 2.0)))
    agent.decide(at(80, (6.0, 5.0, 2.0)))
    assert agent.decide(at(85, (6.0, 5.3, 2.0), status="flying")).kind == "noop"
    assert agent.decide(at(86, (6.0, 5.4, 2.0), ppm=1.0, status="flying")).kind == "waypoint"


def test_a_lost_plume_is_looked_for_on_both_sides_above_and_below():
    places = flown(made(SurgeCast3d, parameters={"lost_m": 1.0}), [1.0] + [0.0] * 4)
    offsets = {(round(y - 5.0, 3), round(z - 2.0, 3)) for _, y, z in places[1:]}
    assert offsets == {(0.75, 0.0), (-0.75, 0.0), (0.0, 0.5), (0.0, -0.5)}
    assert {x for x, _, _ in places} == {6.0}


def test_it_goes_on_at_the_height_of_the_gas():
    agent = made(SurgeCast3d, parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    agent.decide(at(80, (6.0, 5.0, 2.0)))
    agent.observe(at(90, (6.0, 5.0, 2.4), ppm=1.0, status="flying"))
    assert agent.decide(at(120, (6.0, 5.0, 2.5))).position_world_m == (5.0, 5.0, 2.4)


def test_when_a_height_is_seen_it_explores_above_and_then_below():
    agent, place_m, heights = made(SurgeCast3d, parameters={"explore_step_m": 8.0}), START_M, []
    for i in range(12):
        place_m = agent.decide(at(40 + 40 * i, place_m)).position_world_m
        heights.append(place_m[2])
    assert list(dict.fromkeys(heights))[:3] == [2.0, 3.0, 1.0]


def test_without_gas_it_winds_outwards_around_the_place_of_loss():
    places = flown(made(SurgeSpiral, parameters={"lost_m": 1.0, "reach_m": 1.5}), [1.0] + [0.0] * 14)
    away_m = [math.dist(place, places[0]) for place in places[1:]]
    assert away_m == sorted(away_m)
    steps_m = [math.dist(a, b) for a, b in itertools.pairwise(places)]
    assert max(steps_m) <= 0.75 + 0.001


def test_after_the_spiral_it_winds_out_from_the_last_gas_and_then_explores():
    parameters = {"lost_m": 1.0, "shape": "square", "n_sides": 1}
    places = flown(made(SurgeSpiral, parameters=parameters), [1.0] + [0.0] * 3)
    assert math.dist(places[1], (6.0, 5.0, 2.0)) == pytest.approx(1.0)
    assert math.dist(places[2], START_M) == pytest.approx(1.0)
    assert places[3] not in places[:3]


def test_in_a_corner_it_stays_inside_the_margin():
    places = flown(made(SurgeSpiral, parameters={"lost_m": 1.0}), [1.0] + [0.0] * 30, place_m=(1.6, 0.6, 2.0))
    assert all(0.5 <= x <= 14.5 and 0.5 <= y <= 9.5 for x, y, _ in places)


def turns_deg(places):
    """Angle of each leg to upwind, positive to the left."""
    return [
        math.degrees(math.remainder(math.atan2(b[1] - a[1], b[0] - a[0]) - WEST_RAD, math.tau))
        for a, b in itertools.pairwise(places)
    ]


def test_it_tracks_in_by_20_degrees_to_one_side_and_then_to_the_other():
    angles = turns_deg([START_M, *flown(made(MothInspired), [1.0] * 4)])
    assert [abs(angle) for angle in angles] == pytest.approx([20.0] * 4, abs=0.1)
    assert [math.copysign(1, a) for a in angles] in ([1, -1, 1, -1], [-1, 1, -1, 1])


def test_it_tracks_out_straight_upwind_and_then_flies_a_cloverleaf_about_the_last_gas():
    places = flown(made(MothInspired, parameters={"lost_m": 2.0}), [1.0] + [0.0] * 15)
    assert turns_deg(places[:2]) == pytest.approx([0.0], abs=0.1)
    clover = places[2:14]
    assert max(math.dist(place, START_M) for place in clover) <= 1.5 + 0.001
    assert sum(math.dist(place, START_M) < 0.002 for place in clover) == 4
