import numpy as np
import pytest

from gslcosim_bench.statistics import estimates
from gslcosim_bench.statistics.estimates import bootstrap, iterate_row_draws


def drawn(n, **kwargs):
    return np.concatenate(list(iterate_row_draws(n, n_draws=300, **kwargs)))


def test_of_every_stratum_all_but_one_row_are_drawn():
    strata = np.array(["b"] * 3 + ["a"] * 5 + ["b"] * 2)
    rows = drawn(10, strata=strata)
    assert rows.shape == (300, 8)
    assert np.all(np.sum(strata[rows] == "a", axis=1) == 4)
    assert set(np.unique(rows)) == set(range(10))


def test_rows_of_a_cluster_come_together():
    clusters = np.array([7, 8, 9, 7, 8, 9])
    for rows in drawn(6, clusters=clusters):
        counts = np.bincount(rows, minlength=6)
        assert np.array_equal(counts[:3], counts[3:])
        assert counts.sum() == 4


def test_strata_that_share_clusters_are_drawn_together():
    """Starts (strata) that met the same gas (clusters): each draw has every start equally often, and whole gases."""
    strata, clusters = np.repeat([0, 1, 2], 4), np.tile([0, 1, 2, 3], 3)
    for rows in drawn(12, strata=strata, clusters=clusters):
        counts = np.bincount(rows, minlength=12).reshape(3, 4)
        assert np.all(counts == counts[0])
        assert counts[0].sum() == 3


def test_the_same_seed_draws_the_same_rows_and_labels_do_not_matter():
    first = drawn(6, seed=3, clusters=np.array([5, 1, 1, 9, 9, 5]))
    again = drawn(6, seed=3, clusters=np.array(["x", "z", "z", "y", "y", "x"]))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, drawn(6, seed=4, clusters=np.array([5, 1, 1, 9, 9, 5])))


@pytest.mark.parametrize("repetitions", [2, 3, 10])
def test_the_variance_of_a_mean_is_without_bias(repetitions):
    """sum_h s_h^2 / k_h over the squared number of cells, to the error of 20,000 draws."""
    strata = np.repeat(np.arange(8), repetitions)
    values = np.random.default_rng(repetitions).normal(size=strata.size)
    draws = np.concatenate(
        [values[rows].mean(axis=1) for rows in iterate_row_draws(values.size, strata=strata, n_draws=20_000)]
    )
    expected = values.reshape(8, repetitions).var(axis=1, ddof=1).sum() / repetitions / 8**2
    assert draws.var() == pytest.approx(expected, rel=0.05)


def test_one_row_of_each_stratum_gives_no_interval():
    ours = bootstrap(3, lambda rows: rows.mean(axis=1), strata=np.arange(3))
    assert (ours.value, ours.n) == (1.0, 3)
    assert np.isnan([ours.low, ours.high]).all()
    assert np.isnan(bootstrap(6, lambda rows: rows.mean(axis=1), clusters=np.zeros(6)).low)


def test_draws_that_are_asked_for_again_are_those_of_the_first_time(monkeypatch):
    """They are kept within a limit of memory; what is kept, dropped, or never kept is the same to the bit."""
    asked = [{"n": 40}, {"n": 40, "strata": np.arange(40) % 4}, {"n": 300}, {"n": 40, "seed": 5}]
    monkeypatch.setattr(estimates, "_MAX_CACHE_BYTES", 0)
    alone = [drawn(**words) for words in asked]
    # Room for one of the small ones, or for the large one.
    monkeypatch.setattr(estimates, "_MAX_CACHE_BYTES", 200_000)
    again = [[drawn(**words) for words in asked] for _ in range(2)]
    assert len(estimates._draw_cache) > 0
    assert all(np.array_equal(found, kept) for turn in again for found, kept in zip(alone, turn, strict=True))
    assert len({found.tobytes() for found in alone}) == len(asked)
