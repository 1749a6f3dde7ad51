import math

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim.contract.messages import KnownMap
from gslcosim.contract.record import NumericArray
from gslcosim_agents.e_coli.agent import EColi
from gslcosim_agents.e_coli_3d.agent import EColi3d

HERE_M = (7.0, 5.0, 2.0)
ABOVE_M = (7.0, 5.0, 4.0)


def agent(**parameters) -> EColi:
    return EColi(briefing(parameters=parameters))


def read(value):
    return {"nose": value, "nose_ppm": 0.0}


def heading_rad(command):
    x_m, y_m, _ = command.position_world_m
    return math.atan2(y_m - HERE_M[1], x_m - HERE_M[0])


def headings_rad(flown: EColi, ohms, **changes):
    return [
        heading_rad(flown.decide(observation(tick=i, position_m=HERE_M, readings=read(ohm), **changes)))
        for i, ohm in enumerate(ohms)
    ]


def test_it_flies_on_while_the_gas_grows_and_anywhere_when_it_does_not():
    first, surge, again, lost, gas = headings_rad(agent(), [5e4, 4e4, 3e4, 3e4, 2e4])
    assert first == surge == again
    assert lost != again
    assert gas == lost


def test_the_mean_over_a_hold_can_be_compared_instead_of_the_last_reading():
    """A last reading below the one before, in a hold that is above it on the whole."""
    for measure, is_kept in (("last", True), ("mean", False)):
        flown = agent(measure=measure)
        (first,) = headings_rad(flown, [5e4])
        for tick, ohm in ((5, 6e4), (6, 6e4)):
            flown.observe(observation(tick=tick, position_m=(8.0, 5.0, 2.0), readings=read(ohm), asked=False))
        last = observation(tick=7, position_m=(8.0, 5.0, 2.0), readings=read(4e4))
        flown.observe(last)
        x_m, y_m, _ = flown.decide(last).position_world_m
        assert (math.atan2(y_m - 5.0, x_m - 8.0) == pytest.approx(first, abs=0.002)) is is_kept


def at(radius_m, turns):
    """A place around the middle of the room."""
    return (7.0 + radius_m * math.cos(math.tau * turns), 5.0 + radius_m * math.sin(math.tau * turns), 2.0)


def test_much_gas_that_ends_nearby_is_declared_and_the_search_goes_on():
    flown = EColi(briefing(sensors=[("pid", "nose")]))
    places = [(HERE_M, 6.0), *((at(0.3, i / 8), 5.0) for i in range(8)), *((at(1.2, i / 3), 0.0) for i in range(4))]
    said = [
        flown.decide(observation(tick=i, position_m=place_m, readings={"nose": ppm}))
        for i, (place_m, ppm) in enumerate(places)
    ]
    declared = [command for command in said if command.kind == "declare_source"]
    assert len(declared) == 1
    assert math.dist(declared[0].declaration.position_world_m, HERE_M) < 0.1
    assert said[-1].kind == "waypoint"


def steps_m(flown: EColi3d, ohms, here_m=ABOVE_M):
    ends_m = [
        flown.decide(observation(tick=i, position_m=here_m, readings={"nose": ohm})).position_world_m
        for i, ohm in enumerate(ohms)
    ]
    return [tuple(np.round(np.subtract(end_m, here_m), 9)) for end_m in ends_m]


def test_a_surge_through_a_known_wall_is_drawn_again_and_one_above_it_is_not():
    """A wall 3 m high, east of the vehicle, in a map in space."""
    occupied = np.zeros((30, 20, 16), np.uint8)
    occupied[15, :, :6] = 1
    known = KnownMap(origin_m=(0.0, 0.0, 0.0), cell_m=0.5, occupied=NumericArray.from_array(occupied))
    reached_m = {height_m: [] for height_m in (1.5, 4.0)}
    for height_m, found_m in reached_m.items():
        flown = EColi3d(briefing(known_map=known))
        found_m += [7.0 + dx for dx, _, _ in steps_m(flown, [5e4] * 200, (7.0, 5.0, height_m))]
    assert max(reached_m[1.5]) <= 7.5
    assert max(reached_m[4.0]) > 7.9


def test_it_declares_in_space():
    flown = EColi3d(briefing(sensors=[("pid", "nose")]))
    around = [
        (radius_m, math.tau * i / n, ppm) for n, radius_m, ppm in ((8, 0.3, 5.0), (3, 1.2, 0.0)) for i in range(n)
    ]
    places = [((7.0 + r * math.cos(a), 5.0 + r * math.sin(a), 3.0), ppm) for r, a, ppm in [(0.0, 0.0, 6.0), *around]]
    said = [
        flown.decide(observation(tick=i, position_m=place_m, readings={"nose": ppm}))
        for i, (place_m, ppm) in enumerate(places)
    ]
    (declared,) = [command for command in said if command.kind == "declare_source"]
    assert abs(declared.declaration.position_world_m[2] - 3.0) < 1e-9
