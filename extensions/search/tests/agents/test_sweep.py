import math
from itertools import pairwise

import pytest
from briefings import briefing, observation, open_map

from gslcosim.contract.messages import Command
from gslcosim_agents.sweep.agent import Sweep
from gslcosim_search.occupancy import OccupancyMap

START_M = (3.0, 3.0, 2.0)


def bends_m(command):
    """Where a mission rests."""
    return [place.position_world_m for place in command.waypoints if not any(place.velocity_world_m_s)]


def sweep(**parameters) -> Sweep:
    return Sweep(briefing(parameters=parameters))


def test_it_flies_all_lanes_in_one_mission_from_the_nearest_corner_without_holds():
    command = sweep().decide(observation(position_m=START_M))
    assert command.kind == "mission"
    assert bends_m(command)[0] == (0.5, 0.5, 2.0)
    assert len(bends_m(command)) == 12  # lanes of 14 m, 9 m of them 1.8 m apart
    assert {place.hold_s for place in command.waypoints} == {0.0}


def test_places_between_the_bends_are_passed_along_the_lane_at_speed():
    command = sweep(speed_m_s=0.8).decide(observation(position_m=START_M))
    here_m, n_passed = START_M, 0
    for place, after in pairwise(command.waypoints):
        if any(place.velocity_world_m_s):
            n_passed += 1
            assert math.hypot(*place.velocity_world_m_s) == pytest.approx(0.8)
            step_m = [b - a for a, b in zip(here_m, after.position_world_m)]
            cosine = sum(v * d for v, d in zip(place.velocity_world_m_s, step_m)) / 0.8 / math.hypot(*step_m)
            assert cosine == pytest.approx(1.0)
        here_m = place.position_world_m
    assert n_passed > 10


def test_what_it_has_been_to_is_not_flown_again_and_then_it_starts_again():
    agent = sweep()
    places_m = bends_m(agent.decide(observation(position_m=START_M)))
    for place_m in places_m[:5]:
        agent.observe(observation(position_m=place_m, asked=False))
    assert bends_m(agent.decide(observation(position_m=places_m[4]))) == places_m[5:]
    for place_m in places_m[5:]:
        agent.observe(observation(position_m=place_m, asked=False))
    assert bends_m(agent.decide(observation(position_m=places_m[-1])))[0] == places_m[-1]


def test_after_refusals_it_rests_at_bends_then_flies_them_one_by_one_and_leaves_out_the_refused():
    agent, seen = sweep(), observation(position_m=START_M)
    refused = observation(position_m=START_M, notice="waypoints[3]: expected a free place")
    places_m = bends_m(agent.decide(seen))
    second = agent.decide(refused)
    assert [place.position_world_m for place in second.waypoints] == places_m
    third = agent.decide(refused)
    assert (third.kind, third.position_world_m) == ("waypoint", places_m[0])
    assert agent.decide(refused).position_world_m == places_m[1]
    assert agent.decide(seen).position_world_m == places_m[1]


def test_known_solids_are_left_out():
    known = open_map(walls=[(0.0, 0.0, 2.0, 2.0)])
    command = Sweep(briefing(known_map=known)).decide(observation(position_m=START_M))
    assert not any(OccupancyMap.of(known).is_solid(place_m) for place_m in bends_m(command))
    assert len(bends_m(command)) == 11


def reader(*, sensor: str = "pid", **changes) -> Sweep:
    """Return a sweep that declares its largest reading, with lanes at 0.5 m/s."""
    parameters = {"declares": "largest_reading", "speed_m_s": 0.5}
    return Sweep(briefing(sensors=((sensor, "nose"),), parameters=parameters, **changes))


def fly(agent: Sweep, *, gas, time_limit_s: float = 300.0, step_s: float = 0.5) -> tuple[list[Command], float]:
    """Fly what a sweep wants at 0.5 m/s from rest to rest, and return its declarations and when the first was made.

    Args:
        gas: The reading at a place.
    """
    here_m, time_s, declared, first_s = START_M, 0.0, [], math.inf
    while time_s < time_limit_s:
        seen = at(here_m, time_s, gas(here_m))
        command = agent.decide(seen)
        if command.declaration is not None:
            declared.append(command)
            first_s = min(first_s, time_s)
            time_s += step_s
            continue
        for bend_m in bends_m(command):
            n = max(1, math.ceil(math.dist(here_m, bend_m) / (0.5 * step_s)))
            for k in range(1, n + 1):
                place_m = tuple(a + (b - a) * k / n for a, b in zip(here_m, bend_m))
                time_s += step_s
                agent.observe(at(place_m, time_s, gas(place_m), asked=False))
            here_m = bend_m
    return declared, first_s


def at(place_m, time_s: float, value: float, *, asked: bool = True):
    tick = round(time_s * 10)
    return observation(tick=tick, position_m=place_m, readings={"nose": value}, asked=asked)


def puff(place_m, most: float = 5.0) -> float:
    return most * math.exp(-(math.dist(place_m[:2], (9.0, 4.0)) ** 2) / 2.0)


def test_without_the_parameter_it_never_declares_whatever_it_meets():
    assert fly(sweep(speed_m_s=0.5), gas=puff)[0] == []


def test_it_declares_near_the_most_gas_once_when_everything_is_swept():
    declared, first_s = fly(reader(), gas=puff)
    assert len(declared) == 1
    place_m = declared[0].declaration.position_world_m
    assert math.dist(place_m[:2], (9.0, 4.0)) < 2.0  # half a lane, and what a quick nose is corrected by
    assert 180.0 < first_s < 240.0  # lanes of 84 m and 9 m between them, at 0.5 m/s


def test_gas_at_the_start_is_no_reason_to_declare_before_the_sweep():
    command = reader().decide(observation(position_m=START_M, readings={"nose": 9.0}))
    assert command.declaration is None
    assert len(bends_m(command)) == 12


def test_without_gas_it_stays_silent_and_sweeps_on():
    assert fly(reader(), gas=lambda place_m: 0.05, time_limit_s=600.0)[0] == []


def test_it_declares_in_time_what_it_has_met_where_the_time_is_too_short_for_the_room():
    limit_s = 150.0
    declared, first_s = fly(reader(time_limit_s=limit_s), gas=puff, time_limit_s=limit_s)
    assert len(declared) == 1
    assert 0.6 * limit_s < first_s <= 0.9 * limit_s


@pytest.mark.parametrize(
    ("sensor", "reading"),
    [
        ("tgs2600", lambda place_m: 50_000.0 / (1.0 + puff(place_m))),
        ("tdlas", lambda place_m: puff(place_m, 100.0)),
        ("hit_counter", lambda place_m: puff(place_m, 3.0)),
    ],
)
def test_it_reads_any_gas_sensor(sensor, reading):
    declared, _ = fly(reader(sensor=sensor), gas=reading)
    assert math.dist(declared[0].declaration.position_world_m[:2], (9.0, 4.0)) < 3.5
    assert declared[0].declaration.confidence > 0.5


def test_with_heights_it_declares_the_height_of_the_most_gas():
    agent = Sweep(
        briefing(
            sensors=(("pid", "nose"),),
            time_limit_s=600.0,
            parameters={"declares": "largest_reading", "speed_m_s": 0.5, "heights_m": (1.0, 2.5)},
        )
    )
    declared, _ = fly(agent, gas=lambda place_m: puff(place_m) * place_m[2], time_limit_s=600.0)
    assert declared[0].declaration.position_world_m[2] == pytest.approx(2.5)
