import math

import pytest
from briefings import briefing, observation

from gslcosim_agents.e_coli.agent import EColi

HERE_M = (7.0, 5.0, 2.0)


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
