"""The posterior over places: it finds the sources of plumes, and tells plumes from gas that is everywhere."""

import itertools
import math

import numpy as np
import pytest
from plumes import BOUNDS, SOURCE_M, THRESHOLD, lanes, plume_level

from gslcosim.contract.messages import Bounds
from gslcosim_search.posterior import likelihood_kernels
from gslcosim_search.posterior.open_air import OpenAir
from gslcosim_search.posterior.source_posterior import SourcePosterior

HEIGHT_M = 1.5


def posterior_of(bounds=BOUNDS, *, threshold=THRESHOLD):
    return SourcePosterior(OpenAir(bounds), threshold=threshold)


def fly(posterior, places, level, wind_m_s=lambda time_s: (0.5, 0.0)):
    for i, place_m in enumerate(places):
        posterior.air.note_wind(float(i), wind_m_s(float(i)))
        posterior.add(float(i), (*place_m, HEIGHT_M), level(place_m))


@pytest.mark.parametrize("downwind_rad", [0.0, 0.4, -2.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_source_of_a_plume_is_found_within_a_metre(downwind_rad, seed):
    rng, posterior = np.random.default_rng(seed), posterior_of()
    wind_m_s = (0.5 * math.cos(downwind_rad), 0.5 * math.sin(downwind_rad))
    fly(posterior, lanes(), lambda place_m: plume_level(place_m, downwind_rad, rng), lambda _: wind_m_s)
    found = posterior.best()
    assert math.dist(found.position_m[:2], SOURCE_M) < 1.0
    assert found.advantage_nats > 0.5
    assert found.share > 0.3


def test_a_wind_that_turns_leads_to_the_same_place():
    rng, posterior = np.random.default_rng(3), posterior_of()
    n = len([*lanes()])
    for i, place_m in enumerate([*lanes(), *lanes()]):
        downwind_rad = 0.0 if i < n else math.pi / 2.0
        posterior.air.note_wind(float(i), (0.5 * math.cos(downwind_rad), 0.5 * math.sin(downwind_rad)))
        posterior.add(float(i), (*place_m, HEIGHT_M), plume_level(place_m, downwind_rad, rng))
    assert math.dist(posterior.best().position_m[:2], SOURCE_M) < 1.0


def test_gas_in_the_whole_room_comes_from_no_place():
    rng, posterior = np.random.default_rng(4), posterior_of()
    fly(posterior, lanes(), lambda _: float(np.exp(rng.standard_normal())))
    assert posterior.best().advantage_nats < 0.0


def test_clean_air_alone_moves_the_belief_to_where_nothing_was_read():
    posterior = posterior_of()
    assert posterior.p().sum() == pytest.approx(1.0)
    fly(posterior, [(8.0, 3.0)] * 30, lambda _: THRESHOLD)
    assert posterior.best() is None
    plan = posterior.p().sum(axis=2)
    assert plan[:14, 5:7].mean() < 0.8 * plan[:14, 16:].mean()


def test_one_reading_with_gas_is_enough_for_a_best_place():
    posterior = posterior_of()
    fly(posterior, [(3.0, 3.0)], lambda _: 1.0)
    assert posterior.best().n_gas == 1
    assert math.isfinite(posterior.best().advantage_nats)


def test_a_large_room_has_larger_cells_and_extreme_levels_stay_finite():
    large = Bounds(min_m=(-500.0, -500.0, 0.0), max_m=(500.0, 500.0, 9.0))
    posterior = posterior_of(large, threshold=1e-6)
    for level in (0.0, 1e-5, 1e12, 0.0):
        posterior.air.note_wind(0.0, (1.0, 1.0))
        posterior.add(0.0, (400.0, -400.0, 1.0), level)
    assert 0.0 <= posterior.best().share <= 1.0


def test_information_is_that_of_the_joint_distribution():
    """Against the sum over all outcomes: I = sum p(s) p(z | s) ln(p(z | s) / p(z))."""
    rng = np.random.default_rng(7)
    probability = rng.random((5, 3))
    probability /= probability.sum()
    table, entries = np.linspace(0.01, 0.9, 20), rng.integers(0, 12, 5)
    chances = np.array([[table[entries[i] + 4 * k] for k in range(3)] for i in range(5)])
    chance = float((probability * chances).sum())
    expected = sum(
        probability[i, k] * z_given * math.log(z_given / z)
        for i, k in itertools.product(range(5), range(3))
        for z_given, z in ((chances[i, k], chance), (1.0 - chances[i, k], 1.0 - chance))
    )
    found = likelihood_kernels.expected_information_nats(entries, table, 4, probability)
    assert found == pytest.approx(expected, rel=1e-9)


def test_a_reading_tells_more_where_gas_may_come_from_and_less_where_it_was_read():
    posterior = posterior_of()
    # The wind blows along x: at the inlet's side hardly any place could be read.
    fly(posterior, [(15.0, 2.0)] * 40, lambda _: 0.0)
    inlet_side, read, elsewhere = posterior.information_nats(
        40.0, [(0.3, 6.0, HEIGHT_M), (15.0, 2.0, HEIGHT_M), (15.0, 9.0, HEIGHT_M)]
    )
    assert elsewhere > 1.5 * read > 0.0
    assert elsewhere > 1.5 * inlet_side
