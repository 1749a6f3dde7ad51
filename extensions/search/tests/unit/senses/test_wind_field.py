"""The wind that a vehicle has met: means by steps, and their spread over a room against the definition."""

import math

import numpy as np
import pytest
from briefings import observation

from gslcosim_search.beliefs import CellGrid
from gslcosim_search.senses.instruments import Vane
from gslcosim_search.senses.wind_field import WindField, WindRecord

GRID = CellGrid((1.0, -2.0), 0.5, (7, 5))


def seen(tick, wind=(0.5, math.pi), *, velocity_m_s=(0.0, 0.0, 0.0), warming=()):
    return observation(tick=tick, readings={"vane": wind}, velocity_m_s=velocity_m_s, warming=warming)


def test_a_record_of_the_wind_has_a_mean_for_each_step():
    record = WindRecord(Vane(name="vane"), step_s=0.5, n_steps=3)
    for tick in range(1, 22):
        record.add(seen(tick, (0.1 * tick, math.pi)))
        record.add(seen(tick, (9.0, math.pi)))
    assert record.winds_m_s().shape == (3, 2)
    assert record.winds_m_s()[:, 0] == pytest.approx([0.9, 1.4, 1.9], abs=1e-9)
    assert record.places_m() == pytest.approx(np.tile([[7.0, 5.0]], (3, 1)))


def test_the_wind_of_a_moving_vehicle_is_that_of_the_air():
    record = WindRecord(Vane(name="vane"), step_s=0.1, n_steps=10)
    for tick in range(1, 5):
        # It flies east at 1 m/s in still air, and feels a wind from the east.
        record.add(seen(tick, (1.0, 0.0), velocity_m_s=(1.0, 0.0, 0.0)))
    assert np.abs(record.winds_m_s()).max() < 1e-12


def test_a_silence_leaves_the_wind_as_it_was_and_warming_instruments_are_not_believed():
    record = WindRecord(Vane(name="vane"), step_s=0.5, n_steps=100)
    record.add(seen(1, (5.0, 0.0), warming=("vane",)))
    assert len(record.winds_m_s()) == 0
    assert record.mean_wind_m_s() == pytest.approx([0.0, 0.0])
    record.add(seen(2))
    record.add(seen(102))
    assert record.winds_m_s() == pytest.approx(np.tile([[0.5, 0.0]], (20, 1)))


def test_a_field_is_the_kernel_average_of_its_definition():
    field = WindField(GRID, reach_m=0.8, mean_weight=0.1)
    met = {(1.2, -1.9): [(0.4, 0.0)], (3.3, -0.2): [(0.0, 0.3), (0.0, 0.5)]}
    for place_m, winds in met.items():
        for wind in winds:
            field.add(place_m, wind)
    cells_m = np.array([GRID.centre_m(GRID.cell_at(place_m)) for place_m in met])
    means = np.array([np.mean(winds, axis=0) for winds in met.values()])
    squares = ((GRID.centres_m()[:, None, :] - cells_m[None, :, :]) ** 2).sum(axis=-1)
    near = np.exp(-squares / (2 * 0.8**2))
    expected = (near @ means + 0.1 * means.mean(axis=0)) / (near.sum(axis=1, keepdims=True) + 0.1)
    assert field.winds_m_s().reshape(-1, 2) == pytest.approx(expected, abs=1e-12)


def test_what_was_measured_long_ago_counts_less_than_what_is_fresh():
    field = WindField(GRID, reach_m=0.2, memory_s=10.0)
    field.add((1.2, -1.9), (1.0, 0.0))
    field.add((1.2, -1.9), (0.0, 0.0), elapsed_s=10.0 * math.log(3.0))
    assert field.winds_m_s()[0, 0, 0] == pytest.approx(0.25)
