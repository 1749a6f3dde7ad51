import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_bench.metrics.gas import find_encounters, first_contact_s, tracking_ratio

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


def test_whiffs_and_blanks_by_hand():
    """Whiffs from 2 s to 4 s and from 6 s to 7 s, the blank between them from 4 s to 6 s."""
    figures = find_encounters(T_S, GAS_PPM, 0.3)
    assert (figures.n_whiffs, figures.mean_whiff_s) == (2, 1.5)
    assert (figures.n_blanks, figures.mean_blank_s) == (1, 2.0)


def test_a_whiff_may_begin_and_end_with_the_series():
    figures = find_encounters(T_S, np.ones(8), 0.3)
    assert (figures.n_whiffs, figures.mean_whiff_s, figures.n_blanks) == (1, 7.0, 0)
    none = find_encounters(T_S, np.zeros(8), 0.3)
    assert (none.n_whiffs, none.mean_whiff_s, none.n_blanks, none.mean_blank_s) == (0, None, 0, None)


def test_whiffs_and_blanks_fill_the_time_from_contact_to_the_end_of_the_last_whiff():
    rng = np.random.default_rng(2)
    for _ in range(50):
        gas_ppm = rng.random(40) * (rng.random(40) < 0.6)
        figures = find_encounters(np.arange(40.0), gas_ppm, 0.3)
        in_gas = np.flatnonzero(gas_ppm > 0.3)
        filled_s = figures.n_whiffs * figures.mean_whiff_s + figures.n_blanks * (figures.mean_blank_s or 0.0)
        assert filled_s == pytest.approx(min(in_gas[-1] + 1, 39) - in_gas[0])


def test_as_many_values_as_times_are_asked_for():
    with pytest.raises(ShapeError, match="gas_ppm"):
        first_contact_s(T_S, GAS_PPM[:-1], 0.3)
