import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gslcosim.fields.release import ConstantRelease


@given(rate=st.floats(0.01, 1000.0), n_steps=st.integers(1, 200), step_s=st.sampled_from([0.004, 0.05, 0.1, 0.3, 1.0]))
def test_steps_together_give_the_births_of_the_whole_time(rate, n_steps, step_s):
    """However time is cut into steps, the same filaments are born at the same times."""
    release = ConstantRelease(filaments_per_s=rate)
    cut = np.concatenate([release.births_s(i * step_s, (i + 1) * step_s) for i in range(n_steps)])
    np.testing.assert_allclose(cut, release.births_s(0.0, n_steps * step_s), rtol=1e-12)


def test_rate_times_time_filaments_are_born():
    release = ConstantRelease(filaments_per_s=10.0)
    assert [release.n_born_by(t) for t in (0.0, 0.05, 0.1, 0.3, 150.0)] == [0, 0, 1, 3, 1500]


def test_births_lie_within_the_step_and_are_evenly_spread():
    births_s = ConstantRelease(filaments_per_s=7.0).births_s(1.0, 2.0)
    assert births_s.min() > 1.0
    assert births_s.max() <= 2.0
    assert np.diff(births_s) == pytest.approx(1 / 7)
