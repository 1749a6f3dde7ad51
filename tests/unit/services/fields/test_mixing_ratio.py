import math

import numpy as np
import pytest
from built_gas import build_filaments
from built_rooms import build_air

from gslcosim.base.errors import ShapeError
from gslcosim.environment.grid_kernels import is_line_of_sight_free
from gslcosim.environment.model import Cell
from gslcosim_services.fields.mixing_ratio import (
    Walls,
    build_solid_sums,
    is_visible,
    mixing_ratio_and_size_at,
    mixing_ratio_ppm_at,
    mixing_ratio_ppm_on_grid,
)


def test_a_filament_has_its_ppm_at_the_centre_and_falls_as_a_gaussian():
    points = np.array([[1.0, 2.0, 3.0], [1.2, 2.0, 3.0], [1.0, 1.9, 3.1]])
    ppm = mixing_ratio_ppm_at(points, build_filaments([(1.0, 2.0, 3.0)], [0.1]))[:, 0]
    assert ppm == pytest.approx([10.0, 10.0 * math.exp(-2), 10.0 * math.exp(-1)], rel=1e-12)


def test_a_grown_filament_is_diluted_by_the_cube_of_its_size():
    ppm = mixing_ratio_ppm_at(np.zeros((1, 3)), build_filaments([(0.0, 0.0, 0.0)], [0.3]))[0, 0]
    assert ppm == pytest.approx(10.0 / 27.0, rel=1e-12)


def test_beyond_the_cut_off_a_filament_counts_as_zero():
    points = np.array([[0.499, 0.0, 0.0], [0.501, 0.0, 0.0], [0.299, 0.0, 0.0], [0.301, 0.0, 0.0]])
    puff = build_filaments([(0.0, 0.0, 0.0)], [0.1])
    assert (mixing_ratio_ppm_at(points, puff)[:, 0] > 0).tolist() == [True, False, True, True]
    assert (mixing_ratio_ppm_at(points, puff, cutoff_sigma=3.0)[:, 0] > 0).tolist() == [False, False, True, False]


def test_the_size_of_filaments_at_a_point_is_their_mean_by_mixing_ratio():
    """Of 0.1 and 0.2 m at one place, the first has eight times the mixing ratio; far away is neither."""
    puffs, points_m = build_filaments([(0.0, 0.0, 0.0)] * 2, [0.1, 0.2]), np.array([[0.0], [0.8], [9.0]]) * (1, 0, 0)
    _, found_m = mixing_ratio_and_size_at(points_m, puffs, walls=None, cutoff_sigma=5.0)
    assert found_m.tolist() == pytest.approx([(8 * 0.1 + 0.2) / 9, 0.2, 0.0])


def test_gases_are_summed_apart_and_sources_of_one_gas_together():
    puffs = build_filaments(
        [(0.0, 0.0, 0.0)] * 3, [0.1] * 3, source_index=[0, 1, 2], ppm=(10.0, 20.0, 5.0), gas_index=(0, 1, 0)
    )
    assert mixing_ratio_ppm_at(np.zeros((1, 3)), puffs)[0] == pytest.approx([15.0, 20.0])
    grid = {"first_point_m": (0.0, 0.0, 0.0), "spacing_m": 1.0, "shape": (1, 1, 1)}
    assert [mixing_ratio_ppm_on_grid(puffs, gas=i, **grid).item() for i in (0, 1)] == pytest.approx([15.0, 20.0])


@pytest.mark.parametrize("shape", [(9, 7, 5), (12, 6, 1), (1, 4, 8)])
@pytest.mark.parametrize("spacing_m", [0.05, 0.3, 1.5])
def test_grids_equal_the_sum_at_points(shape, spacing_m):
    rng = np.random.default_rng(1)
    first_m = (-1.0, 0.5, 2.0)
    size_m = np.array(shape) * spacing_m
    puffs = build_filaments(first_m + rng.uniform(-0.2, 1.2, (40, 3)) * size_m, rng.uniform(0.1, 0.4, 40))
    grid = mixing_ratio_ppm_on_grid(puffs, first_point_m=first_m, spacing_m=spacing_m, shape=shape)
    points = first_m + np.stack(np.indices(shape), -1).reshape(-1, 3) * spacing_m
    expected = mixing_ratio_ppm_at(points, puffs)[:, 0].reshape(shape)
    assert expected.max() > 0
    np.testing.assert_allclose(grid, expected, rtol=1e-11, atol=0)


def test_gas_behind_a_wall_is_not_read():
    cells = np.zeros((20, 16, 12), np.uint8)
    cells[10, :8, :] = Cell.SOLID
    walls = Walls.of(build_air(cells))
    puff = build_filaments([(2.2, 1.0, 1.0)], [0.4])
    points = np.array([[2.9, 1.0, 1.0], [2.0, 1.0, 1.0], [2.9, 2.4, 1.0]])
    free = mixing_ratio_ppm_at(points, puff)[:, 0]
    assert (free > 0).all()
    assert mixing_ratio_ppm_at(points, puff, walls=walls)[:, 0].tolist() == [0.0, free[1], 0.0]
    around = build_filaments([(2.2, 2.3, 1.0)], [0.3])
    assert mixing_ratio_ppm_at(points[2:], around, walls=walls)[0, 0] > 0


def test_the_summed_table_changes_no_line_of_sight():
    rng = np.random.default_rng(5)
    cells = (rng.random((11, 7, 5)) < 0.05).astype(np.uint8)
    origin_m, cell_m = (-1.0, 0.5, 2.0), 0.4
    walls = Walls(True, cells, build_solid_sums(cells), origin_m, cell_m)
    ends = origin_m + rng.uniform(-0.3, 1.3, (2000, 2, 3)) * np.array(cells.shape) * cell_m
    plain = [is_line_of_sight_free(cells, origin_m, cell_m, *a, *b) for a, b in ends]
    assert [is_visible(walls, *a, *b) for a, b in ends] == plain
    assert 0.2 < np.mean(plain) < 0.8


def test_points_of_another_shape_are_refused():
    with pytest.raises(ShapeError, match=r"expected shape \(m, 3\), was \(3,\)"):
        mixing_ratio_ppm_at(np.zeros(3), build_filaments([(0.0, 0.0, 0.0)], [0.1]))
