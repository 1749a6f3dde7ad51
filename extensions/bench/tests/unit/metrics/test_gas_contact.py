import numpy as np
import pytest

from gslcosim_bench.metrics.gas import first_contact_s, tracking_ratio

T_S = np.arange(8.0)
GAS_PPM = np.array([0.0, 0.3, 0.5, 0.4, 0.0, 0.1, 0.9, 0.0])


def test_contact_is_the_first_gas_above_the_floor_not_at_it():
    assert first_contact_s(T_S, GAS_PPM, 0.3) == 2.0
    assert first_contact_s(T_S, GAS_PPM, 1.0) is None


def test_the_strongest_of_several_noses_counts():
    two = np.stack([GAS_PPM, np.where(T_S == 1.0, 2.0, 0.0)], axis=1)
    assert first_contact_s(T_S, two, 0.3) == 1.0
    assert tracking_ratio(T_S, two, 0.3) == pytest.approx(3 / 6)


def test_the_ratio_is_time_in_gas_by_time_since_contact():
    """From 2 s on five seconds are left; the values at 3 s and 6 s are above the floor."""
    assert tracking_ratio(T_S, GAS_PPM, 0.3) == pytest.approx(2 / 5)


def test_the_ratio_weighs_values_by_the_time_since_the_one_before():
    assert tracking_ratio([0.0, 1.0, 4.0, 5.0], [1.0, 0.0, 1.0, 0.0], 0.3) == pytest.approx(3 / 5)


def test_the_ratio_is_absent_without_contact_and_without_time_after_it():
    assert tracking_ratio(T_S, GAS_PPM, 1.0) is None
    assert tracking_ratio([0.0, 1.0], [0.0, 1.0], 0.3) is None
    assert tracking_ratio([0.0], [1.0], 0.3) is None
