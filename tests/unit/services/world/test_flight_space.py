import pytest

from gslcosim_services.world.flight_space import FlightSpace

CRATE = ("crate", (5.0, 5.0, 0.0), (6.0, 6.5, 1.0))


@pytest.fixture
def space(make_room):
    return FlightSpace(environment=make_room(obstacles=[CRATE]), radius_m=0.4)


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ((1.0, 1.0, 2.0), None),
        ((15.0, 10.0, 5.6), None),
        ((0.0, 0.0, 0.4), None),
        ((5.5, 5.5, 1.01), None),
        ((1000.0, 1.0, 2.0), "waypoint: expected x within 0 to 15 m, was 1000 m."),
        ((float("nan"), 1.0, 2.0), "waypoint: expected x within 0 to 15 m, was nan m."),
        ((1.0, -0.1, 2.0), "waypoint: expected y within 0 to 10 m, was -0.1 m."),
        ((1.0, 1.0, 0.3), "waypoint: expected z within 0.4 to 5.6 m, was 0.3 m."),
        ((1.0, 1.0, 5.7), "waypoint: expected z within 0.4 to 5.6 m, was 5.7 m."),
        ((5.5, 5.5, 0.5), "waypoint: expected a free place, was (5.5, 5.5, 0.5) m, inside crate."),
    ],
)
def test_free_places_are_allowed_and_others_refused_with_what_was_expected_and_found(space, place, text):
    assert space.refusal("waypoint", place) == text


def test_support_is_the_highest_top_below(space):
    assert space.support_height_m((5.5, 5.5, 1.2)) == 1.0
    assert space.support_height_m((5.5, 5.5, 0.2)) == 0.0
    assert space.support_height_m((1.0, 1.0, 3.0)) == 0.0


@pytest.mark.parametrize(
    ("stop", "velocity", "text"),
    [
        ((14.6, 5.0, 2.0), (0.5, 0.0, 0.0), "at x within 0.5 to 14.5 m, was heading for 14.60 m."),
        ((7.0, 5.0, 0.3), (0.0, 0.0, -0.5), "at z within 0.5 to 5.5 m, was heading for 0.30 m."),
        ((5.5, 5.5, 0.6), (0.5, 0.0, 0.0), "in a free place, was heading for (5.5, 5.5, 0.6) m, inside crate."),
    ],
)
def test_the_edge_ahead_is_named(space, stop, velocity, text):
    assert space.find_edge_ahead("velocity", stop, velocity) == f"velocity: expected a stop {text}"


def test_moving_away_from_an_edge_is_no_reason_to_brake(space):
    assert space.find_edge_ahead("velocity", (14.7, 5.0, 2.0), (-0.5, 0.0, 0.0)) is None
