import math

import numpy as np
import pytest
from scipy.special import kve
from scipy.stats import poisson

from gslcosim.contract.messages import NominalPlume
from gslcosim_search.bayes.encounter_model import (
    EncounterModel,
    hit_probability,
    likelihoods,
    log_k0,
    nominal_dispersal,
)

PLUME = NominalPlume(
    release_ppm_m3_s=1.575, puffs_per_s=10.0, initial_sigma_m=0.1, growth_m2_s=0.001, diffusivity_m2_s=0.002,
    wind_speed_m_s=0.5,
)  # fmt: skip


def demo(**changes) -> EncounterModel:
    """The published demonstration of infotaxis with wind (rkp8000/infotaxis)."""
    figures = {
        "dimensions": 2, "emission_per_s": 5.0, "diffusivity_m2_s": 0.05, "lifetime_s": 100.0, "detector_m": 0.003,
        "wind_m_s": (0.5, 0.0),
    }  # fmt: skip
    return EncounterModel(**{**figures, **changes})


def mean_hits(model: EncounterModel, place_m, source_m) -> float:
    return float(np.exp(model.log_mean_hits(np.array([place_m], float), np.array([source_m], float))[0, 0]))


def granted(**changes):
    needed = {"dimensions": 2, "threshold_ppm": 0.1, "room_length_m": 15.0, "detector_m": 0.1, "correlation_s": 5.0}
    return nominal_dispersal(PLUME, **{**needed, "stop_s": 2.0, **changes})


def test_log_k0_is_that_of_scipy_from_tiny_to_huge_arguments():
    x = np.concatenate([np.geomspace(1e-12, 1e5, 2000), [2.0, np.nextafter(2.0, 3.0)]])
    assert [log_k0(one) for one in x] == pytest.approx(np.log(kve(0, x)) - x, rel=2e-7, abs=2e-7)


def test_the_rate_with_wind_is_the_published_formula():
    place, source = (1.3, 0.4), (0.5, 0.1)
    d = math.hypot(0.8, 0.3)
    k0 = kve(0, d / demo().length_m) * math.exp(-d / demo().length_m)
    expected = 1.1916939 * math.exp(0.5 * 0.8 / 0.1) * k0
    assert mean_hits(demo(), place, source) == pytest.approx(expected, rel=1e-5)


def test_in_space_the_rate_is_the_published_formula():
    model = demo(dimensions=3, detector_m=0.1)
    d = math.hypot(0.8, 0.3, 0.2)
    expected = 5.0 * 0.1 / d * math.exp(0.5 * 0.8 / 0.1 - d / model.length_m)
    assert mean_hits(model, (1.3, 0.4, 1.2), (0.5, 0.1, 1.0)) == pytest.approx(expected)


def test_without_wind_all_sides_are_alike():
    calm = demo(wind_m_s=(0.0, 0.0))
    assert calm.length_m == pytest.approx(math.sqrt(0.05 * 100.0))
    assert mean_hits(calm, (1.0, 0.0), (0.0, 0.0)) == pytest.approx(mean_hits(calm, (0.0, -1.0), (0.0, 0.0)))


def test_nearer_than_the_nose_the_mean_does_not_grow():
    assert mean_hits(demo(), (0.0, 0.0), (0.0, 0.0)) == pytest.approx(
        mean_hits(demo(wind_m_s=(0.5, 0.0)), (0.0, 0.003), (0.0, 0.0)), rel=1e-9
    )


def test_a_room_of_hundreds_of_lengths_gives_finite_logarithms():
    model = demo(wind_m_s=(5.0, 0.0))
    far = np.array([[1000.0, 0.0], [-1000.0, 0.0]])
    assert np.isfinite(model.log_mean_hits(far, np.zeros((1, 2)))).all()


@pytest.mark.parametrize("wind_m_s", [(0.0, 0.0), (0.3, 0.4), (2.0, 0.0)])
@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_calibrated_source_is_met_as_often_as_stated_at_a_metre_downwind(wind_m_s, dimensions):
    model = demo(dimensions=dimensions, wind_m_s=wind_m_s, stop_s=2.0).calibrated(1.7)
    speed = math.hypot(*wind_m_s) or 1.0
    downwind = (wind_m_s[0] / speed, wind_m_s[1] / speed) if any(wind_m_s) else (1.0, 0.0)
    rest = (0.0,) * (dimensions - 2)
    assert mean_hits(model, (*downwind, *rest), (0.0, 0.0, *rest)) == pytest.approx(1.7)


def test_a_nominal_plume_gives_eddies_growth_and_the_age_at_which_puffs_fade():
    dispersal = granted()
    assert dispersal.diffusivity_m2_s == pytest.approx(0.0025)
    # At the end of its life a puff's centre is at the threshold.
    sigma_m = math.sqrt(0.01 + 0.001 * dispersal.lifetime_s)
    assert 0.1575 / ((2.0 * math.pi) ** 1.5 * sigma_m**3) == pytest.approx(0.1)


def test_a_wandering_wind_widens_the_plume_and_gas_that_crossed_the_room_is_gone():
    steady, wandering = granted().model((0.5, 0.0), 0.0), granted().model((0.5, 0.0), 0.5)
    assert wandering.diffusivity_m2_s == pytest.approx(steady.diffusivity_m2_s + 0.5**4 * 5.0)
    assert steady.lifetime_s == pytest.approx(30.0)
    aside, source = (5.0, 1.0), (0.0, 0.0)
    assert mean_hits(wandering, aside, source) > 1e4 * mean_hits(steady, aside, source)


@pytest.mark.parametrize("n_outcomes", [2, 3, 5])
@pytest.mark.parametrize("mean", [1e-6, 0.01, 0.9, 1.1, 4.0, 100.0])
def test_outcomes_are_poisson_with_a_tail(n_outcomes, mean):
    found = [hit_probability(math.log(mean), h, n_outcomes) for h in range(n_outcomes)]
    expected = [*poisson.pmf(range(n_outcomes - 1), mean), poisson.sf(n_outcomes - 2, mean)]
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-15)
    assert sum(found) == pytest.approx(1.0)


def test_a_floor_rules_nothing_out_and_keeps_the_sum():
    log_mean = np.array([[-800.0, 40.0]])
    likelihood, weight, log_weight = likelihoods(log_mean, n_outcomes=2, floor=1e-3)
    assert likelihood[0].sum(axis=0) == pytest.approx([1.0, 1.0])
    assert likelihood.min() == pytest.approx(1e-3)
    assert weight is likelihood
    assert log_weight == pytest.approx(np.log(likelihood))


def test_tempering_takes_the_power_of_the_likelihood():
    log_mean = np.linspace(-5.0, 2.0, 7)[None, :]
    likelihood, weight, log_weight = likelihoods(log_mean, n_outcomes=3, floor=0.01, power=0.4)
    assert weight == pytest.approx(likelihood**0.4)
    assert np.exp(log_weight) == pytest.approx(weight)


def test_an_outcome_that_is_ruled_out_has_weight_zero_and_no_infinite_logarithm():
    _, weight, log_weight = likelihoods(np.array([[-800.0]]), n_outcomes=2)
    assert weight[0, 1, 0] == 0.0
    assert log_weight[0, 1, 0] == 0.0
