"""Power of paired comparisons: that of simulated pairs, and the numbers of pairs that the docs state."""

import numpy as np
import pytest

from gslcosim.base.errors import ModelError, ShapeError
from gslcosim_bench.statistics.pairs import mcnemar
from gslcosim_bench.statistics.power import paired_power, pairs_needed


@pytest.mark.parametrize(("n_pairs", "difference", "discordance"), [(60, 0.2, 0.3), (216, 0.1, 0.25), (40, 0.1, 0.1)])
def test_the_power_is_the_share_of_simulated_comparisons_that_find_the_difference(n_pairs, difference, discordance):
    rng = np.random.default_rng(1)
    n_simulated = 800
    only_a = (discordance + difference) / 2
    found = 0
    for _ in range(n_simulated):
        kind = rng.choice(3, size=n_pairs, p=[only_a, discordance - only_a, 1 - discordance])
        found += mcnemar(kind == 0, kind == 1).p <= 0.05
    expected = paired_power(n_pairs, difference=difference, discordance=discordance)
    error = np.sqrt(expected * (1 - expected) / n_simulated)
    assert abs(found / n_simulated - expected) < 4 * error + 1e-3


def test_the_number_of_pairs_is_the_first_of_the_power():
    n_pairs = pairs_needed(difference=0.1, discordance=0.25)
    assert paired_power(n_pairs, difference=0.1, discordance=0.25) >= 0.8
    assert paired_power(n_pairs - 1, difference=0.1, discordance=0.25) < 0.8
    assert pairs_needed(difference=0.1, discordance=0.25, design_effect=1.3) == int(np.ceil(1.3 * n_pairs))


def test_differences_that_cannot_be_are_refused():
    with pytest.raises(ShapeError, match="0 < difference <= discordance"):
        paired_power(10, difference=0.3, discordance=0.2)
    with pytest.raises(ModelError, match="Ask for a larger difference"):
        pairs_needed(difference=0.001, discordance=0.5)
