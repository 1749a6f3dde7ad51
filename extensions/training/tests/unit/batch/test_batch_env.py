"""Which case a search draws."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.batch.batch_env import cumulate_case_fractions, find_drawn_cases

LAST = 2**32 - 1


def test_without_weights_all_cases_come_equally_often():
    assert cumulate_case_fractions(None, 3) is None
    assert np.bincount(find_drawn_cases(np.arange(9), 3, None)).tolist() == [3, 3, 3]


def test_cases_come_as_often_as_their_weights_say():
    drawn = np.random.default_rng(1).integers(2**32, size=4000)
    shares = cumulate_case_fractions([1, 0, 3, 0], 4)
    counts = np.bincount(find_drawn_cases(drawn, 4, shares), minlength=4)
    assert counts[1] == counts[3] == 0
    assert counts[2] / counts[0] == pytest.approx(3, rel=0.1)


def test_the_first_and_the_last_number_stand_for_cases_that_come():
    shares = cumulate_case_fractions([0, 0.1, 0.2, 0], 4)
    assert find_drawn_cases(np.array([0, LAST]), 4, shares).tolist() == [1, 2]


@pytest.mark.parametrize("weights", [[1, 2], [1, -1, 1], [0, 0, 0], [1, np.nan, 1]], ids=str)
def test_weights_that_mean_nothing_are_refused(weights):
    with pytest.raises(UsageError, match="reset: options: weights: expected 3 numbers from 0, one for each case"):
        cumulate_case_fractions(weights, 3)
