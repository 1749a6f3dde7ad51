"""What cases have cost, and how often they come by it."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.trainers.trainer import Curriculum

ENDS = np.array([True, True, False, True])


def infos():
    return {
        "case": np.array([0, 1, 0, 1]),
        "success": np.array([True, False, True, True]),
        "time_s": np.array([50.0, 100.0, 1.0, 20.0]),
        "distance_to_source_m": np.array([0.5, 4.0, 0.5, 0.5]),
    }


def costs():
    return Curriculum(
        lambda means: np.nan_to_num(means, nan=9.0) / np.nansum(np.nan_to_num(means, nan=9.0)),
        time_limits_s=np.array([100.0, 100.0, 100.0]), diagonals_m=np.array([10.0, 8.0, 8.0]),
    )  # fmt: skip


@pytest.mark.parametrize("ended", [infos(), {"success": None, "final_info": infos()}], ids=["next_step", "same_step"])
def test_the_newest_search_of_a_case_counts_a_half(ended):
    mine = costs()
    mine.count(ended, ENDS)
    # A half of the time; a failure at half the diagonal and then a fifth of the time; not flown.
    np.testing.assert_allclose(mine.costs, [0.5, (1.5 + 0.2) / 2, np.nan])
    np.testing.assert_allclose(mine.shares, np.array([0.5, 0.85, 9.0]) / 10.35)


def test_an_environment_that_does_not_show_its_cases_is_refused():
    with pytest.raises(UsageError, match=r"doping: expected environments that tell case, .* was without case, time_s"):
        costs().count({"success": ENDS, "distance_to_source_m": ENDS}, ENDS)
