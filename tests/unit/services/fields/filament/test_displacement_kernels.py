import math

import numpy as np
import pytest

from gslcosim_services.fields.filament.counter_rng import (
    BATCH,
    BOUNDED,
    DT,
    ETA,
    FATE,
    FREE,
    MOVED,
    N_WORK,
    NORMAL,
    POSITION,
    REACH,
    RISE,
    SIGMA,
)
from gslcosim_services.fields.filament.filament_step import age_filaments, displace_filaments, find_reach, find_rise


def row(work, first, n=1):
    return work[first : first + n]


def test_newborn_move_for_the_rest_of_their_step():
    work = np.zeros(N_WORK)
    births, sources = np.array([3.0, 9.0, 9.75]), np.array([0, 1, 1], np.int32)
    age_filaments(births, sources, np.array([0.1, 0.2]), 10, 0.5, 0.04, 0.01, work)
    assert row(work, DT, 3).tolist() == [0.5, 0.5, 0.125]
    assert row(work, ETA, 3).tolist() == [0.04, 0.04, 0.02]
    age_s = np.array([3.5, 0.5, 0.125])
    np.testing.assert_allclose(row(work, SIGMA, 3) ** 2, np.array([0.01, 0.04, 0.04]) + 0.01 * age_s, rtol=1e-14)


@pytest.mark.parametrize("power", [1, 3])
def test_rise_falls_with_the_size(power):
    work = np.zeros(N_WORK)
    find_rise(np.array([0.1, 0.2]), np.array([1, 1], np.int32), np.array([5.0, -0.01]), power, work)
    np.testing.assert_allclose(row(work, RISE, 2), [-0.01 / 0.1**power, -0.01 / 0.2**power], rtol=1e-14)


def test_reach_is_almost_a_cell_where_all_neighbours_are_free():
    is_open = np.zeros((5, 4, 3), np.uint8)
    is_open[2, 1, 1] = 1
    work = np.zeros(N_WORK)
    places = [(2.5, 1.2, 1.9), (1.99, 1.2, 1.9), (5.0, 3.9, 2.9), (4.9, 4.0, 3.0)]
    work[POSITION : POSITION + 3 * BATCH].reshape(3, BATCH)[:, :4] = np.transpose(places)
    find_reach(is_open, 0.2, 4, np.zeros(BATCH, np.int64), work)
    assert row(work, REACH, 4) == pytest.approx([0.2, 0.0, 0.0, 0.0], rel=1e-6)


@pytest.mark.parametrize(
    ("x_m", "wind_m_s", "reach_m", "fate"),
    [
        (0.5, 0.3, 0.0, FREE),
        (0.5, 0.6, 0.0, BOUNDED),
        (0.5, 0.6, 1.0, FREE),
        (0.5, 1.2, 1.0, BOUNDED),
        (0.5, -0.6, 0.0, BOUNDED),
        (1.0, 0.0, 0.0, BOUNDED),
        (0.5, math.nan, 1.0, BOUNDED),
        (0.5, math.inf, 1.0, BOUNDED),
    ],
)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_free_is_what_stays_in_its_cell_or_within_reach(axis, x_m, wind_m_s, reach_m, fate):
    work, wind = np.zeros(N_WORK), np.zeros(3 * BATCH, np.float32)
    position_m = np.full(3, 0.5)
    position_m[axis], wind[axis * BATCH] = x_m, wind_m_s
    work[POSITION : POSITION + 3 * BATCH : BATCH] = position_m
    work[DT], work[REACH] = 1.0, reach_m
    displace_filaments(position_m, wind, 1.0, work)
    assert work[FATE] == fate


def test_eddies_move_by_their_standard_deviation_along_each_axis():
    work, wind = np.zeros(N_WORK), np.zeros(3 * BATCH, np.float32)
    work[NORMAL : NORMAL + 3 * BATCH : BATCH] = (1.0, -2.0, 0.5)
    work[ETA], work[DT], work[RISE] = 0.1, 0.5, 0.2
    displace_filaments(np.array([1.0, 2.0, 3.0]), wind, 0.2, work)
    assert work[MOVED : MOVED + 3 * BATCH : BATCH] == pytest.approx([1.1, 1.8, 3.15])
