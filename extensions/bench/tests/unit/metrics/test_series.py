import numpy as np

from gslcosim_bench.metrics.series import select_samples


def test_rounding_of_ticks_does_not_shift_a_sample():
    """0.05 s ticks as k * 50e6 * 1e-9 are off by a last digit here and there."""
    t_s = np.array([k * 50_000_000 * 1e-9 for k in range(6001)])
    np.testing.assert_array_equal(select_samples(t_s), np.arange(0, 6001, 20))


def test_what_is_kept_is_first_last_and_no_two_closer_than_needed():
    rng = np.random.default_rng(1)
    for _ in range(50):
        t_s = rng.exponential(0.3, 100).cumsum()
        kept = select_samples(t_s)
        assert (kept[0], kept[-1]) == (0, 99)
        assert len(np.unique(np.floor(t_s[kept[:-1]]))) == len(kept) - 1
        assert set(np.floor(t_s)) == set(np.floor(t_s[kept]))
