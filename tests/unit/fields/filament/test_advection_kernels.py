import numpy as np
import pytest

from gslcosim.environment.wind_kernels import trilinear_wind_at_points
from gslcosim.fields.filament.advection_kernels import wind_at_filaments


@pytest.mark.parametrize("shape", [(7, 5, 4), (1, 5, 4), (7, 1, 4), (7, 5, 1), (2, 2, 2), (1, 1, 1)])
def test_equals_the_double_precision_interpolation(shape):
    """In boxes of three side lengths and in grids one cell thick, inside and outside of them."""
    rng = np.random.default_rng(3)
    origin_m, cell_m = (-1.0, 2.0, 0.5), 0.3
    velocity_m_s = rng.standard_normal((*shape, 3)).astype(np.float32)
    points_m = origin_m + rng.uniform(-0.2, 1.2, (200, 3)) * np.array(shape) * cell_m
    found = np.zeros((200, 3), np.float32)
    wind_at_filaments(velocity_m_s, origin_m, cell_m, points_m, 0, 200, found)
    expected = trilinear_wind_at_points(velocity_m_s, origin_m, cell_m, points_m)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_only_the_asked_filaments_are_looked_up():
    velocity_m_s = np.ones((3, 4, 5, 3), np.float32)
    found = np.zeros((4, 3), np.float32)
    wind_at_filaments(velocity_m_s, (0.0, 0.0, 0.0), 1.0, np.ones((9, 3)), 5, 2, found)
    assert found[:, 0].tolist() == [1.0, 1.0, 0.0, 0.0]
