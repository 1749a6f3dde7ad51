import stops_in_wind
from ribbon_world import Ribbon, fly
from stops_in_wind import START_M, at, flown

from gslcosim_agents.surge_cast.agent import SurgeCast
from gslcosim_agents.surge_cast_3d.agent import SurgeCast3d


def made(**changes):
    return stops_in_wind.made(SurgeCast3d, **changes)


def test_a_lost_plume_is_looked_for_on_both_sides_above_and_below():
    places = flown(made(parameters={"lost_m": 1.0}), [1.0] + [0.0] * 4)
    offsets = {(round(y - 5.0, 3), round(z - 2.0, 3)) for _, y, z in places[1:]}
    assert offsets == {(0.75, 0.0), (-0.75, 0.0), (0.0, 0.5), (0.0, -0.5)}
    assert {x for x, _, _ in places} == {6.0}


def test_it_goes_on_at_the_height_of_the_gas():
    agent = made(parameters={"lost_m": 1.0})
    agent.decide(at(40, ppm=1.0))
    agent.decide(at(80, (6.0, 5.0, 2.0)))
    agent.observe(at(90, (6.0, 5.0, 2.4), ppm=1.0, status="flying"))
    assert agent.decide(at(120, (6.0, 5.0, 2.5))).position_world_m == (5.0, 5.0, 2.4)


def test_when_a_height_is_seen_it_explores_above_and_then_below():
    agent, place_m, heights = made(parameters={"explore_step_m": 8.0}), START_M, []
    for i in range(12):
        place_m = agent.decide(at(40 + 40 * i, place_m)).position_world_m
        heights.append(place_m[2])
    assert list(dict.fromkeys(heights))[:3] == [2.0, 3.0, 1.0]


def test_of_a_thin_plume_above_its_height_it_makes_more_than_the_plane_search():
    plume = Ribbon(height_m=3.0, half_m=0.3, wave_m=0.8)
    starts = [(16.0, 5.0, 2.0), (17.0, 2.0, 2.0), (12.0, 8.0, 2.0)]
    space_s, plane_s = (
        sum(fly(agent, plume, start_m=start_m, limit_s=150.0).found_s or 150.0 for start_m in starts)
        for agent in (SurgeCast3d, SurgeCast)
    )
    assert space_s < 0.7 * plane_s
