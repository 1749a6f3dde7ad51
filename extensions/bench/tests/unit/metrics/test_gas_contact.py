import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
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


def test_a_track_in_gas_all_along_has_the_ratio_one():
    assert tracking_ratio(T_S, np.ones(8), 0.3) == 1.0


def test_neither_time_of_day_nor_a_fine_sampling_changes_the_ratio():
    fine_s, fine_ppm = np.arange(1, 81) / 10.0 - 1.0, np.repeat(GAS_PPM, 10)
    assert tracking_ratio(T_S + 100.0, GAS_PPM, 0.3) == pytest.approx(2 / 5)
    # The first value of the whiff at 2 s now begins nine tenths of a second earlier.
    assert tracking_ratio(fine_s, fine_ppm, 0.3) == pytest.approx(2.9 / 5.9)


def test_as_many_values_as_times_are_asked_for():
    with pytest.raises(ShapeError, match="gas_ppm"):
        first_contact_s(T_S, GAS_PPM[:-1], 0.3)
