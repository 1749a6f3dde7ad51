"""How a budget is shared."""

import pytest

from gslcosim.base.errors import UsageError
from gslcosim_bench.studies.tuning import split_budget


@pytest.mark.parametrize("flights", [8, 12, 37, 60, 200, 1000, 12_345])
def test_a_budget_is_never_exceeded_and_a_setting_more_would_exceed_it(flights):
    budget = split_budget(flights)
    used = budget.search + budget.validation
    assert used <= flights < used + budget.per_setting
    assert budget.per_validation >= budget.per_setting
    assert budget.n_settings >= 2


def test_runs_of_a_setting_grow_with_the_root_of_the_budget():
    assert [split_budget(flights).per_setting for flights in (12, 100, 400, 10_000)] == [2, 5, 10, 50]
    assert split_budget(400).per_validation == 40
    assert split_budget(400, 20).n_settings == 16


def test_a_budget_that_is_too_small_is_reported():
    assert split_budget(4, 1).n_settings == 2
    with pytest.raises(UsageError, match=r"^--budget: expected at least 8 flights, .* with 2 flights each; was 7\."):
        split_budget(7)
    with pytest.raises(UsageError, match="at least 40 flights"):
        split_budget(39, 10)
