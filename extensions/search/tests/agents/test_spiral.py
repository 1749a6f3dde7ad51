import itertools
import math

import pytest
from briefings import briefing, observation
from ribbon_world import Cloud, fly

from gslcosim_agents.spiral.agent import Spiral

START_M = (7.0, 5.0, 2.0)


def made(**changes):
    return Spiral(briefing(**{"sensors": (("pid", "nose"),), **changes}))


def at(tick, place_m=START_M, *, ppm=0.0, notice=None):
    return observation(tick=tick, position_m=place_m, readings={"nose": ppm}, notice=notice)


def flown(agent, amounts, place_m=START_M):
    """Places commanded after stops of two samples each."""
    places = []
    for i, ppm in enumerate(amounts):
        agent.observe(at(39 + 40 * i, place_m, ppm=ppm))
        place_m = agent.decide(at(40 + 40 * i, place_m, ppm=ppm)).position_world_m
        places.append(place_m)
    return places


def legs_m(places):
    return [math.dist(a, b) for a, b in itertools.pairwise(places)]


def test_more_gas_begins_the_spiral_again_and_less_lets_it_grow():
    places = [START_M, *flown(made(), [1.0, 0.5, 0.5, 2.0, 0.5, 0.5])]
    assert legs_m(places) == pytest.approx([1.0, 1.0, 1.5, 1.0, 1.0, 1.5], abs=0.002)


def test_gas_that_is_met_on_the_way_is_gone_back_to():
    agent = made()
    agent.decide(at(40))
    agent.observe(at(50, (7.5, 5.5, 2.0), ppm=1.0).model_copy(update={"status": "flying"}))
    assert agent.decide(at(80, (8.5, 6.5, 2.0))).position_world_m == (7.5, 5.5, 2.0)


@pytest.mark.parametrize("nose", ["pid", "binary", "tgs2600"])
@pytest.mark.parametrize("start_m", [(6.0, 2.0, 2.0), (7.0, 5.0, 2.0)])
def test_it_finds_a_source_in_still_air_without_a_wind_sensor(nose, start_m):
    flight = fly(Spiral, Cloud(half_m=1.5), nose=nose, start_m=start_m, has_vane=False, limit_s=300.0)
    assert flight.found_s is not None
