import math

import numpy as np
import pytest

from gslcosim.contract.messages import Belief
from gslcosim.contract.record import NumericArray
from gslcosim_services.referee.metrics import compute_belief_score, entropy_bits

SOURCE_M = (2.6, 1.2, 2.0)


def belief(p, *, cell_m=1.0, origin_m=(0.0, 0.0, 2.0)):
    return Belief(origin_m=origin_m, cell_m=cell_m, probability=NumericArray.from_array(np.asarray(p, np.float32)))


def test_all_mass_in_the_cell_of_the_source_scores_best():
    p = np.zeros((4, 3))
    p[2, 1] = 1.0
    score = compute_belief_score(belief(p), [(2.5, 1.5, 2.0)], within_m=0.5)
    figures = score.expected_distance_m, score.mass_near_frac, score.cell_frac, score.entropy_bits
    assert figures == (0.0, 1.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("sources_m", "cell_frac"), [([(9.0, 9.0, 1.0), (0.5, 0.5, 1.0)], 1.0), ([(-0.1, 0.5, 1.0)], 0.0)]
)
def test_the_nearest_of_several_sources_counts_and_one_outside_is_in_no_cell(sources_m, cell_frac):
    assert compute_belief_score(belief(np.ones((1, 1))), sources_m, within_m=0.1).cell_frac == cell_frac


def test_the_expected_distance_is_that_of_each_cell_weighted_by_its_probability():
    p = np.zeros((4, 3))
    p[0, 0], p[2, 1] = 0.25, 0.75
    score = compute_belief_score(belief(p), [SOURCE_M], within_m=1.0)
    near_m, far_m = math.dist((2.5, 1.5), SOURCE_M[:2]), math.dist((0.5, 0.5), SOURCE_M[:2])
    assert score.expected_distance_m == pytest.approx(0.75 * near_m + 0.25 * far_m)
    assert (score.mass_near_frac, score.cell_frac) == (0.75, 0.75)
    assert score.entropy_bits == pytest.approx(-0.25 * math.log2(0.25) - 0.75 * math.log2(0.75))


def test_a_belief_in_space_is_judged_in_space_and_one_in_the_plane_in_the_plane():
    p = np.full((1, 1, 4), 0.25)
    in_space = compute_belief_score(belief(p, origin_m=(0.0, 0.0, 0.0)), [(0.5, 0.5, 3.5)], within_m=0.5)
    assert in_space.expected_distance_m == pytest.approx((0 + 1 + 2 + 3) / 4)
    in_plane = compute_belief_score(belief(np.ones((1, 1)), origin_m=(0.0, 0.0, 0.0)), [(0.5, 0.5, 3.5)], within_m=0.5)
    assert in_plane.expected_distance_m == 0.0


def test_even_beliefs_have_the_logarithm_of_their_cells_as_entropy():
    assert entropy_bits(np.full(64, 1 / 64)) == pytest.approx(6.0)
