import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from gslcosim_services.world.trajectory import Limits, plan_to_point, plan_to_velocity

TICK_NS = 100_000_000
LIMITS = Limits(max_speed_m_s=1.2, max_acceleration_m_s2=2.5)

place = st.tuples(*[st.floats(-20.0, 20.0) for _ in range(3)])
direction = st.tuples(*[st.floats(-1.0, 1.0) for _ in range(3)])


def scaled(vector, size):
    length = math.sqrt(sum(v * v for v in vector))
    return np.array(vector) * (size / length if length > 1e-6 else 0.0)


def peaks(trajectory):
    states = [trajectory.state_at(t, 1_000_000) for t in np.linspace(0, trajectory.duration_s * 1000, 200).astype(int)]
    return max(np.linalg.norm(s[1]) for s in states), max(np.linalg.norm(s[2]) for s in states)


# The first example may compile.
@settings(deadline=None)
@given(place, place, direction, st.floats(0.0, 1.2))
def test_a_leg_from_flight_keeps_its_limits_and_ends_at_rest(start_m, end_m, heading, speed_m_s):
    start = np.array([start_m, scaled(heading, speed_m_s), (0.0,) * 3])
    trajectory = plan_to_point(start, end_m, LIMITS, 0)
    speed, acceleration = peaks(trajectory)
    assert speed <= LIMITS.max_speed_m_s * 1.01
    assert acceleration <= LIMITS.max_acceleration_m_s2 * 1.01
    assert np.allclose(trajectory.state_at(0, TICK_NS), start, atol=1e-9)
    before_end = trajectory.state_at(int(trajectory.duration_s * 1e9), 1)
    assert np.allclose(before_end[0], end_m, atol=1e-6)


# The first example may compile.
@settings(deadline=None)
@given(place, direction, st.floats(0.0, 1.2), direction, st.floats(0.0, 2.5), direction)
def test_a_change_of_velocity_stays_below_the_speed_limit(start_m, heading, speed_m_s, push, push_m_s2, wanted):
    start = np.array([start_m, scaled(heading, speed_m_s), scaled(push, push_m_s2)])
    velocity = tuple(scaled(wanted, 1.2).tolist())
    trajectory = plan_to_velocity(start, velocity, LIMITS, 0)
    speed, acceleration = peaks(trajectory)
    # Speed at its limit and still accelerating cannot be kept below it: the overshoot is bounded instead.
    assert speed <= LIMITS.max_speed_m_s * 1.3
    assert acceleration <= LIMITS.max_acceleration_m_s2 * 1.3
    assert np.allclose(trajectory.state_at(0, TICK_NS), start, atol=1e-9)


# The first example may compile.
@settings(deadline=None)
@given(place, direction, st.floats(0.0, 1.2), direction, st.floats(0.0, 2.5))
def test_a_stop_ends_within_the_braking_distance(start_m, heading, speed_m_s, push, push_m_s2):
    start = np.array([start_m, scaled(heading, speed_m_s), scaled(push, push_m_s2)])
    trajectory = plan_to_velocity(start, (0.0, 0.0, 0.0), LIMITS, 0)
    length_m = math.dist(trajectory.end_world_m, start_m)
    assert trajectory.duration_s <= 5.0 * LIMITS.max_speed_m_s / LIMITS.max_acceleration_m_s2
    assert length_m <= 1.3 * LIMITS.max_speed_m_s * trajectory.duration_s
