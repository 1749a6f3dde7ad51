import math

import numpy as np
import pytest

from gslcosim_services.world.trajectory import (
    Limits,
    peak_speed_and_acceleration,
    plan_quickest_inplace,
    plan_rest,
    plan_to_point,
    plan_to_state,
    plan_to_velocity,
    polynomial_at,
    rest_to_rest_duration,
    set_quartic_to_velocity_inplace,
    set_quintic_inplace,
)

TICK_NS = 100_000_000
LIMITS = Limits(max_speed_m_s=1.0, max_acceleration_m_s2=2.0)


def at_rest(position_m):
    return np.array([position_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)])


def test_a_rest_to_rest_leg_is_the_quintic_of_flash_and_hogan():
    trajectory = plan_to_point(at_rest((1.0, 2.0, 3.0)), (4.0, 6.0, 3.0), LIMITS, 0)
    for tick in range(int(trajectory.duration_s * 10)):
        s = tick * 0.1 / trajectory.duration_s
        share = 10 * s**3 - 15 * s**4 + 6 * s**5
        position_m = trajectory.state_at(tick, TICK_NS)[0]
        assert position_m == pytest.approx([1.0 + 3.0 * share, 2.0 + 4.0 * share, 3.0], abs=1e-12)


@pytest.mark.parametrize("distance_m", [0.01, 0.3, 5.0, 40.0])
def test_rest_to_rest_peaks_reach_the_tighter_limit_exactly(distance_m):
    duration_s = rest_to_rest_duration(distance_m, 1.0, 2.0)
    peak_speed = 15.0 / 8.0 * distance_m / duration_s
    peak_acceleration = 10.0 / math.sqrt(3.0) * distance_m / duration_s**2
    assert max(peak_speed / 1.0, peak_acceleration / 2.0) == pytest.approx(1.0)


def test_sampled_peaks_are_within_half_a_percent_of_the_closed_form():
    coefficients = np.empty((3, 6))
    set_quintic_inplace(coefficients, at_rest((0.0, 0.0, 0.0)), at_rest((3.0, 0.0, 4.0)), 2.0)
    speed, acceleration = peak_speed_and_acceleration(coefficients, 2.0)
    assert speed == pytest.approx(15.0 / 8.0 * 5.0 / 2.0, rel=5e-3)
    assert acceleration == pytest.approx(10.0 / math.sqrt(3.0) * 5.0 / 4.0, rel=5e-3)


def test_the_quintic_meets_start_and_end():
    start = np.array([[1.0, -2.0, 3.0], [0.5, 0.1, -0.4], [0.3, -0.2, 1.0]])
    wanted = np.array([[4.0, 4.0, 4.0], [-0.3, 0.2, 0.6], [0.5, -1.0, 0.2]])
    coefficients = np.empty((3, 6))
    set_quintic_inplace(coefficients, start, wanted, 3.0)
    begin = np.array([polynomial_at(coefficients, i, 0.0)[:3] for i in range(3)]).T
    end = np.array([polynomial_at(coefficients, i, 3.0)[:3] for i in range(3)]).T
    assert begin == pytest.approx(start, abs=1e-12)
    assert end == pytest.approx(wanted, abs=1e-12)


def test_a_stop_covers_half_of_speed_times_duration():
    """With a0 = 0 the way is T (v0 + v_end) / 2 and the acceleration peaks at 1.5 dv/T."""
    start = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    stop = plan_to_velocity(start, (0.0, 0.0, 0.0), LIMITS, 0)
    assert stop.duration_s == pytest.approx(1.5 * 1.0 / 2.0)
    assert stop.end_world_m == pytest.approx((0.5 * stop.duration_s, 0.0, 2.0))
    assert peak_speed_and_acceleration(stop.coefficients, stop.duration_s)[1] == pytest.approx(2.0)


def test_the_quartic_meets_its_end_velocity_without_acceleration():
    start = np.array([[0.0, 1.0, 2.0], [1.0, 0.0, -0.5], [0.4, -0.3, 0.2]])
    coefficients = np.empty((3, 6))
    set_quartic_to_velocity_inplace(coefficients, start, np.array([0.0, 0.7, 0.1]), 1.7)
    for axis, end_velocity in enumerate((0.0, 0.7, 0.1)):
        assert polynomial_at(coefficients, axis, 0.0)[:3] == pytest.approx(tuple(start[:, axis]))
        position, velocity, acceleration, _ = polynomial_at(coefficients, axis, 1.7)
        assert (velocity, acceleration) == pytest.approx((end_velocity, 0.0), abs=1e-12)
        distance_m = 1.7 * (start[1, axis] + end_velocity) / 2 + 1.7**2 * start[2, axis] / 12
        assert position - start[0, axis] == pytest.approx(distance_m)


def test_values_are_derivatives_of_one_another():
    coefficients = np.random.default_rng(0).normal(size=(3, 6))
    h = 1e-5
    for t in (0.3, 1.1):
        below, here, above = (polynomial_at(coefficients, 1, t + step) for step in (-h, 0.0, h))
        for order in range(3):
            assert (above[order] - below[order]) / (2 * h) == pytest.approx(here[order + 1], rel=1e-6)


def test_after_its_end_a_trajectory_rests_or_flies_on():
    leg = plan_to_point(at_rest((0.0, 0.0, 0.0)), (1.0, 0.0, 0.0), LIMITS, 5)
    assert leg.state_at(5 + 600, TICK_NS).tolist() == [[1.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3]
    cruise = plan_to_velocity(at_rest((0.0, 0.0, 0.0)), (0.5, 0.0, 0.0), LIMITS, 0)
    a, b = cruise.state_at(100, TICK_NS), cruise.state_at(110, TICK_NS)
    assert (b[0] - a[0]).tolist() == pytest.approx([0.5, 0.0, 0.0])
    assert plan_rest((1.0, 2.0, 3.0), 7).state_at(7, TICK_NS)[0].tolist() == [1.0, 2.0, 3.0]


def test_a_state_that_is_flown_through_is_met_at_its_time():
    end = np.array([[2.0, 1.0, 0.0], [0.0, 0.8, 0.0], [-0.4, 0.0, 0.0]])
    leg = plan_to_state(at_rest((0.0, 0.0, 0.0)), end, LIMITS, 3, least_s=4.0, step_s=0.1)
    assert leg.duration_s == pytest.approx(4.0)
    assert leg.is_over(43, TICK_NS)
    assert not leg.is_over(42, TICK_NS)
    assert leg.state_at(43, TICK_NS) == pytest.approx(end)
    assert leg.state_at(53, TICK_NS) == pytest.approx(np.array([[2.0, 1.8, 0.0], [0.0, 0.8, 0.0], [0.0] * 3]))


def test_a_state_that_comes_too_soon_is_reached_later_within_the_limits():
    end = np.array([[5.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0] * 3])
    leg = plan_to_state(at_rest((0.0, 0.0, 0.0)), end, LIMITS, 0, least_s=0.5, step_s=0.1)
    speed, acceleration = peak_speed_and_acceleration(leg.coefficients, leg.duration_s)
    assert speed <= 1.0 * 1.02
    assert acceleration <= 2.0 * 1.02
    assert leg.duration_s * 10 == pytest.approx(round(leg.duration_s * 10))


def test_the_quickest_path_is_that_of_a_search_that_looks_at_every_duration():
    rng = np.random.default_rng(4)
    found, sought = np.zeros((3, 6)), np.zeros((3, 6))
    n_searched = 0
    for _ in range(300):
        start, end = rng.normal(size=(2, 3, 3)) * np.array([[2.0], [0.6], [0.8]])
        is_velocity = bool(rng.integers(2))
        end[2] = 0.0
        end[1] *= is_velocity
        if is_velocity:
            first_s = max(0.2, 0.3 * 1.5 * math.dist(end[1], start[1]) / 2.0)
        else:
            first_s = max(0.2, 0.3 * rest_to_rest_duration(math.dist(end[0], start[0]), 1.0, 2.0))
        limits = max(1.0, *(math.hypot(*state[1]) for state in (start, end))), max(2.0, math.hypot(*start[2]))
        for n in range(250):
            duration_s = first_s * 1.04**n
            if is_velocity:
                set_quartic_to_velocity_inplace(sought, start, end[1], duration_s)
            else:
                set_quintic_inplace(sought, start, end, duration_s)
            peaks = peak_speed_and_acceleration(sought, duration_s)
            if max(peaks[0] / limits[0], peaks[1] / limits[1]) <= 1 + 1e-9:
                planned_s = plan_quickest_inplace(found, start, end, is_velocity, 1.0, 2.0, 0.0, 0.0)
                assert planned_s == pytest.approx(duration_s, rel=1e-12)
                np.testing.assert_allclose(found, sought, rtol=1e-9, atol=1e-9)
                n_searched += n > 0
                break
    assert n_searched > 150
