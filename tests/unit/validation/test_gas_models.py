"""Plumes of gas models in an open field, as records that can be scored."""

import numpy as np
import pytest

from gslcosim.validation.gas_models import DISTANCES_M, GAS_SETTINGS, record_plume, score_plume


@pytest.mark.slow
@pytest.mark.parametrize("name", GAS_SETTINGS)
def test_each_setting_gives_a_record_that_follows_from_its_seed(name):
    first, second, other = (record_plume(GAS_SETTINGS[name], seconds=2.0, seed=seed) for seed in (1, 1, 2))
    assert first.shape == (20, len(DISTANCES_M))
    assert (first >= 0).all()
    assert first.any()
    np.testing.assert_array_equal(first, second)
    assert (first != other).any()


def test_scores_are_those_of_each_distance():
    rng = np.random.default_rng(1)
    record = np.column_stack([rng.gamma(1.0, 1.0, 4000), rng.gamma(4.0, 1.0, 4000)])
    near, far = score_plume(record)
    assert near.intensity.value == pytest.approx(1.0, abs=0.1)
    assert far.intensity.value == pytest.approx(0.5, abs=0.05)
