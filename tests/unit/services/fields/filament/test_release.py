from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gslcosim.base.rng import stream
from gslcosim_services.fields.filament.release import (
    ConstantRelease,
    IntermittentRelease,
    PoissonRelease,
    ScheduledRelease,
    VariableRelease,
)


def test_rate_times_time_filaments_are_born():
    release = ConstantRelease(filaments_per_s=10.0)
    assert [release.n_born_by(t) for t in (0.0, 0.05, 0.1, 0.3, 150.0)] == [0, 0, 1, 3, 1500]


def test_births_lie_within_the_step_and_are_evenly_spread():
    births_s = ConstantRelease(filaments_per_s=7.0).births_s(1.0, 2.0)
    assert min(births_s) > 1.0
    assert max(births_s) <= 2.0
    assert np.diff(births_s) == pytest.approx(1 / 7)


PLANS = {
    "constant": ConstantRelease(filaments_per_s=20.0),
    "poisson": PoissonRelease(filaments_per_s=20.0),
    "variable": VariableRelease(filaments_per_s=20.0, interval_s=0.7),
    "intermittent": IntermittentRelease(filaments_per_s=20.0, on_s=1.3, off_s=2.1),
    "scheduled": ScheduledRelease(schedule=((0.5, 20.0), (2.0, 0.0), (3.0, 40.0))),
}


def births_s(plan, time_s, step_s, seed=1):
    births = plan.start(stream(seed, "test"))
    edges = np.arange(round(time_s / step_s) + 1) * step_s
    return np.concatenate([births.births_s(a, b) for a, b in pairwise(edges)])


@pytest.mark.parametrize("name", PLANS)
@given(step_s=st.sampled_from([0.01, 0.1, 0.5, 2.5]), seed=st.integers(0, 100))
def test_no_plan_depends_on_the_step(name, step_s, seed):
    np.testing.assert_allclose(
        births_s(PLANS[name], 10.0, step_s, seed), births_s(PLANS[name], 10.0, 10.0, seed), rtol=1e-12
    )


@pytest.mark.parametrize("name", PLANS)
def test_births_are_ascending_and_within_their_step(name):
    births = PLANS[name].start(stream(1, "test"))
    for i in range(40):
        times = np.array(births.births_s(i * 0.3, (i + 1) * 0.3))
        assert (times >= i * 0.3 - 1e-9).all()
        assert (times <= (i + 1) * 0.3).all()
        assert (np.diff(times) >= 0).all()


def test_poisson_births_have_exponential_gaps():
    gaps_s = np.diff(births_s(PLANS["poisson"], 500.0, 1.0))
    n = len(gaps_s)
    assert gaps_s.mean() == pytest.approx(0.05, rel=4 / np.sqrt(n))
    assert gaps_s.std() == pytest.approx(0.05, rel=0.05)
    assert abs(np.corrcoef(gaps_s[1:], gaps_s[:-1])[0, 1]) < 4 / np.sqrt(n)


def test_a_variable_rate_is_half_of_the_full_one_in_the_mean():
    births = births_s(PLANS["variable"], 700.0, 7.0)
    assert len(births) == pytest.approx(0.5 * 20.0 * 700.0, rel=4 / np.sqrt(12 * 1000) * 2)
    per_interval = np.histogram(births, np.arange(0.0, 700.1, 0.7))[0]
    assert per_interval.min() <= 1
    assert per_interval.max() >= 13


def test_an_intermittent_release_pauses():
    births = births_s(PLANS["intermittent"], 34.0, 0.1)
    assert ((births - 1e-6) % 3.4 < 1.3).all()
    assert len(births) == 10 * 26


def test_a_schedule_changes_the_rate_at_its_times():
    births = births_s(PLANS["scheduled"], 5.0, 0.1)
    counts = [((births > a + 1e-9) & (births <= b + 1e-9)).sum() for a, b in ((0, 0.5), (0.5, 2), (2, 3), (3, 5))]
    assert counts == [0, 30, 0, 80]
