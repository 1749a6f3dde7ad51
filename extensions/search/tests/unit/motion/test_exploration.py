"""Exploration by information: the next leg goes to where a reading tells the most, and stays in the room."""

import math

from plumes import BOUNDS, THRESHOLD

from gslcosim_search.motion.exploration import exploration_leg_end_m
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.posterior.open_air import OpenAir
from gslcosim_search.posterior.source_posterior import SourcePosterior

ROOM = LegSpace.within(BOUNDS, 0.3)


def posterior_after(places, wind_m_s=(0.5, 0.0)):
    posterior = SourcePosterior(OpenAir(BOUNDS), threshold=THRESHOLD)
    for i, place_m in enumerate(places):
        posterior.air.note_wind(float(i), wind_m_s)
        posterior.add(float(i), (*place_m, 1.5), 0.0)
    return posterior


def test_it_goes_to_where_nothing_was_read_in_legs_of_two_metres_at_most():
    here_m = (12.0, 3.0, 1.5)
    place_m = exploration_leg_end_m(posterior_after([here_m[:2]] * 60), 60.0, here_m, ROOM)
    assert place_m[1] > 3.5
    assert math.dist(place_m, here_m[:2]) <= 2.0 + 1e-9
    assert ROOM.contains(place_m)


def test_lanes_of_its_choice_cross_the_whole_wind():
    """From the corner downwind it sees the whole width of the room before it ends."""
    posterior, here_m, rows = posterior_after([]), (14.0, 0.6, 1.5), set()
    for i in range(60):
        posterior.air.note_wind(4.0 * i, (0.5, 0.0))
        posterior.add(4.0 * i, here_m, 0.0)
        here_m = (*exploration_leg_end_m(posterior, 4.0 * i, here_m, ROOM), 1.5)
        rows.add(int(here_m[1] / 2.0))
    assert rows >= {0, 1, 2, 3, 4}


def test_without_a_wind_and_in_a_closet_there_is_no_such_place():
    posterior = SourcePosterior(OpenAir(BOUNDS), threshold=THRESHOLD)
    assert exploration_leg_end_m(posterior, 0.0, (1.0, 1.0, 1.0), ROOM) is None
    closet = LegSpace(min_m=(1.0, 1.0, 1.0), max_m=(1.2, 1.2, 1.2))
    assert exploration_leg_end_m(posterior_after([(1.1, 1.1)]), 1.0, (1.1, 1.1, 1.1), closet) is None
