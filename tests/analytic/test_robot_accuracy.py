"""What vehicles promise, line by line of the report in docs/studies, and the report itself."""

import math

import numpy as np
import pytest

from gslcosim.contract.messages import Waypoint


def test_a_vehicle_is_as_accurate_as_promised(figure):
    assert figure.measure() <= figure.target


def test_the_ellipse_is_passed_at_constant_speed_along_its_tangent(robot_study):
    ellipse = robot_study.Ellipse(centre_m=(7.0, 5.0, 2.0), a_m=2.0, b_m=1.0, speed_m_s=1.0)
    h = 1e-3
    for t_s in (0.3, 2.0, 5.5):
        before, here, after = (ellipse.state_at(t) for t in (t_s - h, t_s, t_s + h))
        assert math.hypot(*here[1]) == pytest.approx(1.0)
        for order in range(2):
            slope = (np.array(after[order]) - np.array(before[order])) / (2 * h)
            assert slope == pytest.approx(np.array(here[order + 1]), abs=2e-3)
    assert ellipse.state_at(ellipse.lap_s)[0] == pytest.approx(ellipse.state_at(0.0)[0], abs=1e-6)
    # Ramanujan's second approximation of the perimeter.
    assert ellipse.lap_s == pytest.approx(9.688448, rel=1e-6)


def test_an_ellipse_can_be_given_place_by_place(robot_study):
    ellipse = robot_study.Ellipse(centre_m=(7.0, 5.0, 2.0), a_m=2.0, b_m=1.0, speed_m_s=1.0)
    limits = {"max_speed_m_s": 1.2, "max_acceleration_m_s2": 2.5}
    flight = robot_study.Flight(robot_study.closed_room(), mode="lockstep", start_m=(9.0, 5.0, 0.1), **limits)
    for _ in range(60):
        flight.step()
    flight.step(kind="mission", waypoints=(passed(ellipse, 0.0, 3.0),))
    squares = []
    for _ in range(29):
        flight.step()
    for i in range(100):
        body = flight.step(kind="mission", waypoints=(passed(ellipse, 0.1 * i + 0.2, 0.2),))
        squares.append(math.dist(body.position_world_m, ellipse.state_at(0.1 * i + 0.1)[0]) ** 2)
    assert math.sqrt(np.mean(squares)) < 0.05


def passed(ellipse, t_s, after_s):
    place_m, velocity_m_s, acceleration_m_s2 = ellipse.state_at(t_s)
    return Waypoint(
        position_world_m=place_m,
        velocity_world_m_s=velocity_m_s,
        acceleration_world_m_s2=acceleration_m_s2,
        after_s=after_s,
    )
