import numpy as np
import pytest

from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim_services.fields.filament.counter_rng import BATCH
from gslcosim_services.fields.filament.filament_step import (
    positions_in_cells,
    wind_at_filaments,
    wind_at_filaments_in_flat_grid,
)

ORIGIN_M, CELL_M, N = (-1.0, 2.0, 0.5), 0.3, 100


def grid_and_points(shape):
    """Wind without a pattern, and points inside and outside of its grid."""
    rng = np.random.default_rng(3)
    velocity_m_s = rng.standard_normal((*shape, 3)).astype(np.float32)
    return velocity_m_s, ORIGIN_M + rng.uniform(-0.2, 1.2, (N, 3)) * np.array(shape) * CELL_M


@pytest.mark.parametrize("shape", [(7, 5, 4), (2, 2, 2), (40, 3, 2)])
def test_equals_the_double_precision_interpolation(shape):
    velocity_m_s, points_m = grid_and_points(shape)
    place, found = np.zeros(3 * BATCH), np.zeros(3 * BATCH, np.float32)
    positions_in_cells(points_m.reshape(-1), ORIGIN_M, CELL_M, place)
    corner, weight = np.zeros(BATCH, np.int64), np.zeros(3 * BATCH, np.float32)
    wind_at_filaments(velocity_m_s, place, N, corner, weight, found)
    expected = trilinear_wind_at_points(velocity_m_s, ORIGIN_M, CELL_M, points_m)
    np.testing.assert_allclose(found.reshape(3, BATCH)[:, :N].T, expected, rtol=0, atol=2e-6)


@pytest.mark.parametrize("shape", [(1, 5, 4), (7, 1, 4), (7, 5, 1), (1, 1, 1)])
def test_equals_the_double_precision_interpolation_in_grids_one_cell_thick(shape):
    velocity_m_s, points_m = grid_and_points(shape)
    found = np.zeros(3 * BATCH, np.float32)
    wind_at_filaments_in_flat_grid(velocity_m_s, ORIGIN_M, CELL_M, points_m.reshape(-1), found)
    expected = trilinear_wind_at_points(velocity_m_s, ORIGIN_M, CELL_M, points_m)
    np.testing.assert_array_equal(found.reshape(3, BATCH)[:, :N].T, expected.astype(np.float32))


def test_only_the_asked_filaments_are_looked_up():
    velocity_m_s = np.ones((3, 4, 5, 3), np.float32)
    corner, weight = np.zeros(BATCH, np.int64), np.zeros(3 * BATCH, np.float32)
    found = np.zeros(3 * BATCH, np.float32)
    wind_at_filaments(velocity_m_s, np.ones(3 * BATCH), 2, corner, weight, found)
    assert found.reshape(3, BATCH).sum(axis=1).tolist() == [2.0, 2.0, 2.0]
