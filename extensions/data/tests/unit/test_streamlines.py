"""Streamlines: along the wind, inside the air, and no longer than asked for."""

import numpy as np
import pytest

from gslcosim_data.environment_view import streamlines

CRATE = ("crate", (5.0, 4.0, 0.0), (6.0, 6.0, 6.0))


def length_of(line_m):
    return float(np.linalg.norm(np.diff(line_m, axis=0), axis=1).sum())


def test_in_even_wind_they_are_straight_and_as_long_as_asked_for(make_room):
    room = make_room(wind_m_s=[(0.3, 0.4, 0.0)])
    (line_m,) = streamlines(room, np.array([[2.0, 2.0, 1.0]]), max_length_m=5.0)
    assert length_of(line_m) == pytest.approx(5.0)
    assert line_m[-1] == pytest.approx((5.0, 6.0, 1.0))


def test_they_end_before_a_solid_and_inside_the_room(make_room):
    room = make_room(wind_m_s=[(1.0, 0.0, 0.0)], obstacles=[CRATE])
    stopped, passing = streamlines(room, np.array([[1.0, 5.0, 1.0], [1.0, 2.0, 1.0]]), max_length_m=50.0)
    assert 4.7 <= stopped[-1][0] < 5.0
    assert 14.7 <= passing[-1][0] <= 15.0


def test_on_a_circle_they_stay_on_it(make_room):
    """The midpoint rule keeps the radius to second order: after half a turn it has changed by less than a hundredth."""
    room = make_room(wind_m_s=[(0.0, 0.0, 0.0)])
    centres_m = room.grid.centres_m()
    velocity = room.wind.velocity_m_s
    velocity[0, ..., 0], velocity[0, ..., 1] = -(centres_m[..., 1] - 5.0), centres_m[..., 0] - 7.0
    (line_m,) = streamlines(room, np.array([[10.0, 5.0, 1.0]]), max_length_m=3.0 * np.pi)
    assert np.linalg.norm(line_m[:, :2] - (7.0, 5.0), axis=1) == pytest.approx(3.0, abs=0.03)
    assert line_m[-1][0] == pytest.approx(4.0, abs=0.2)


def test_still_air_and_places_outside_the_air_have_none(make_room):
    assert streamlines(make_room(), np.array([[2.0, 2.0, 1.0]]), max_length_m=5.0) == []
    room = make_room(wind_m_s=[(1.0, 0.0, 0.0)], obstacles=[CRATE])
    assert streamlines(room, np.array([[5.5, 5.0, 1.0], [-1.0, 5.0, 1.0]]), max_length_m=5.0) == []
