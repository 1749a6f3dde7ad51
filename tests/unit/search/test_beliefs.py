"""Occupancy by several sources: Bayes' rule cell by cell, declarations, and gas that is explained already."""

import math

import numpy as np
import pytest

from gslcosim.search.bayes.puff_tracing import PuffModel, footprint, partial_sums_m
from gslcosim.search.beliefs import CellGrid, SourceOccupancy

GRID = CellGrid((0.0, 0.0), 0.5, (12, 10))


def test_each_cell_follows_bayes_rule_for_itself():
    chance = np.random.default_rng(1).uniform(0.0, 0.9, GRID.shape)
    occupancy = SourceOccupancy(GRID, prior=0.1, background=0.2)
    odds = np.full(GRID.shape, 0.1 / 0.9)
    for is_hit in (True, False, True):
        occupancy.update(chance, is_hit=is_hit)
        with_source = 1.0 - 0.8 * (1.0 - chance)
        odds *= with_source / 0.2 if is_hit else (1.0 - with_source) / 0.8
    assert occupancy.probability() == pytest.approx(odds / (1.0 + odds))


def test_what_cannot_be_sensed_from_here_changes_nothing():
    occupancy = SourceOccupancy(GRID)
    before = occupancy.probability()
    for is_hit in (True, False):
        occupancy.update(np.zeros(GRID.shape), is_hit=is_hit)
    assert occupancy.probability() == pytest.approx(before)


def test_log_odds_are_clamped():
    occupancy, sure = SourceOccupancy(GRID, most_log_odds=5.0), np.ones(GRID.shape)
    occupancy.update(sure, is_hit=False)
    assert occupancy.log_odds == pytest.approx(np.full(GRID.shape, -5.0))
    for _ in range(9):
        occupancy.update(sure, is_hit=True)
    assert occupancy.log_odds == pytest.approx(np.full(GRID.shape, 5.0))


def test_a_masked_place_is_neither_found_nor_changed_again():
    occupancy = SourceOccupancy(GRID)
    assert occupancy.found() is None
    chance = np.zeros(GRID.shape)
    chance[3, 4] = 0.9
    for _ in range(6):
        occupancy.update(chance, is_hit=True)
    place_m = occupancy.found()
    assert place_m == pytest.approx(GRID.centre_m((3, 4)))
    occupancy.mask(place_m, 0.6)
    odds = occupancy.log_odds[3, 4]
    occupancy.update(chance, is_hit=False)
    assert occupancy.found() is None
    assert occupancy.log_odds[3, 4] == odds
    assert int(occupancy.is_masked.sum()) == 5


def test_a_declared_source_explains_gas_that_it_may_have_sent():
    here, there = np.zeros(GRID.shape), np.zeros(GRID.shape)
    here[3, 4], here[8, 4], there[8, 4] = 0.9, 0.5, 0.5
    knowing, ignorant = SourceOccupancy(GRID), SourceOccupancy(GRID)
    knowing.mask(GRID.centre_m((3, 4)), 0.6)
    for occupancy in (knowing, ignorant):
        occupancy.update(here, is_hit=True)
    assert 0.0 < knowing.log_odds[8, 4] - math.log(0.01 / 0.99) < 0.1
    assert ignorant.log_odds[8, 4] - math.log(0.01 / 0.99) > 1.5


def test_two_sources_in_still_air_are_found_one_after_the_other_and_no_third():
    """A flight over all cells, with findings drawn from the model itself; in still air gas is met near its source."""
    rng, sources = np.random.default_rng(3), [(3, 2), (6, 7)]
    model = PuffModel(step_s=1.0, window_s=6.0, initial_sigma_m=0.2, spread_m_sqrt_s=0.05, sensed_m2=0.25)
    offsets = footprint(model, partial_sums_m(np.zeros((6, 2)), 1.0), 0.5, GRID.shape)
    occupancy, found = SourceOccupancy(GRID, background=0.01), []
    for _ in range(20):
        for i, j in np.ndindex(GRID.shape):
            chance = offsets[11 - i : 23 - i, 9 - j : 19 - j]
            silent = math.prod(1.0 - chance[cell] for cell in sources) * 0.99
            occupancy.update(chance, is_hit=bool(rng.random() > silent))
        if (place_m := occupancy.found()) is not None:
            found.append(GRID.cell_at(place_m))
            occupancy.mask(place_m, 0.8)
    assert sorted(found) == sources
