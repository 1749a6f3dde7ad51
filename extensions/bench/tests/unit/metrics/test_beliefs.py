import math

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim.contract.messages import Belief
from gslcosim.contract.record import NumericArray
from gslcosim_bench.metrics.beliefs import (
    error_of_mean_m,
    mean_m,
    minus_log_p,
    resample_belief,
    score_belief,
    source_credible_level,
)

ORIGIN = (1.0, -2.0, 0.5)


def belief(p, *, cell_m=0.5, origin_m=ORIGIN):
    single = (np.asarray(p) / np.sum(p)).astype(np.float32)
    return Belief(origin_m=origin_m, cell_m=cell_m, probability=NumericArray.from_array(single))


def test_a_point_mass_at_the_source_is_perfect():
    p = np.zeros((6, 4))
    p[2, 3] = 1.0
    figures = score_belief(belief(p), [(2.25, -0.25, 9.0)], within_m=1.0)
    assert (figures.expected_distance_m, figures.error_m, figures.mass_near) == (0.0, 0.0, 1.0)
    assert (figures.entropy_bits, figures.minus_log_p, figures.level) == (0.0, 0.0, 0.0)


def test_the_mean_of_two_places_by_hand():
    p = np.zeros((4, 2, 3))
    p[0, 0, 0], p[3, 1, 2] = 3.0, 1.0
    np.testing.assert_allclose(mean_m(p, ORIGIN, 2.0), [2.0 + 6.0 / 4, -1.0 + 2.0 / 4, 1.5 + 4.0 / 4])
    assert error_of_mean_m(p, ORIGIN, 2.0, [(3.5, -0.5, 5.5), (99.0, 0.0, 0.0)]) == pytest.approx(3.0)


def test_the_error_of_the_mean_is_at_most_the_expected_distance():
    rng = np.random.default_rng(1)
    for shape in [(5, 7), (4, 3, 6)] * 10:
        source = tuple(rng.uniform(-3.0, 5.0, 3))
        figures = score_belief(belief(rng.random(shape) ** 5), [source], within_m=1.0)
        assert figures.error_m <= figures.expected_distance_m + 1e-9


def test_there_is_no_logarithm_where_the_source_was_ruled_out_or_lies_outside():
    p = np.ones((8, 4))
    p[0, 0] = 0.0
    assert minus_log_p(p, ORIGIN, 0.5, [(1.1, -1.9, 0.0)]) is None
    assert minus_log_p(p, ORIGIN, 0.5, [(0.9, -1.9, 0.0)]) is None
    assert source_credible_level(p, ORIGIN, 0.5, [(1.1, -1.9, 0.0)]) == 1.0
    assert source_credible_level(p, ORIGIN, 0.5, [(0.9, -1.9, 0.0)]) == 1.0


def test_of_several_sources_the_one_believed_most_counts():
    p = np.array([[0.5, 0.3], [0.2, 0.0]])
    sources = [(0.5, 1.5, 0.0), (0.5, 0.5, 0.0), (7.0, 7.0, 7.0)]
    assert minus_log_p(p, (0.0, 0.0, 0.0), 1.0, sources) == pytest.approx(math.log(2))
    assert source_credible_level(p, (0.0, 0.0, 0.0), 1.0, sources) == 0.0


def test_the_level_is_what_is_believed_more_than_the_cell_of_the_source():
    p = np.array([[0.5, 0.3], [0.2, 0.0]])
    levels = [
        source_credible_level(p, (0.0, 0.0, 0.0), 1.0, [(x, y, 0.0)]) for x, y in [(0.5, 0.5), (0.5, 1.5), (1.5, 0.5)]
    ]
    assert levels == pytest.approx([0.0, 0.5, 0.8])


def test_a_belief_on_other_cells_keeps_its_mass_and_its_mean():
    rng = np.random.default_rng(4)
    for shape, cell_m, new_cell_m in [((7, 5), 0.2, 0.5), ((3, 4), 1.0, 0.5), ((4, 5, 6), 0.3, 0.5)]:
        p = rng.random(shape)
        moved = resample_belief(p, cell_m, new_cell_m)
        assert moved.sum() == pytest.approx(1.0)
        assert all(n * new_cell_m >= m * cell_m - 1e-9 for n, m in zip(moved.shape, shape, strict=True))
        # Mass is spread within a cell, so the mean stays within half a new cell on each axis.
        away_m = np.abs(mean_m(moved, ORIGIN, new_cell_m) - mean_m(p, ORIGIN, cell_m))
        assert (away_m <= new_cell_m / 2 + 1e-9).all()


def test_cells_are_summed_and_split_by_hand():
    np.testing.assert_allclose(resample_belief([[1.0, 2.0, 3.0, 4.0]], 0.25, 0.5), [[0.3, 0.7]])
    np.testing.assert_allclose(resample_belief([[1.0, 3.0]], 1.0, 0.5), np.array([[1, 1, 3, 3], [1, 1, 3, 3]]) / 16)
    np.testing.assert_allclose(resample_belief([[1.0], [1.0], [2.0]], 0.2, 0.3), [[1.5 / 4], [2.5 / 4]])


def test_even_beliefs_of_methods_with_other_cells_have_the_same_logarithm():
    fine, coarse = (
        score_belief(
            belief(np.ones((round(6 / cell_m), round(4 / cell_m))), cell_m=cell_m), [(3.3, 0.7, 1.0)], within_m=1
        )
        for cell_m in (0.25, 1.0)
    )
    assert fine.minus_log_p == pytest.approx(coarse.minus_log_p)
    assert fine.minus_log_p == pytest.approx(math.log(12 * 8))


@pytest.mark.parametrize("wrong", [np.zeros((3, 3)), np.ones(4)])
def test_what_is_no_belief_is_refused(wrong):
    with pytest.raises(ShapeError, match="p: expected"):
        mean_m(wrong, ORIGIN, 1.0)
