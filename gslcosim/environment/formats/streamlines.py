"""Streamlines of an environment's wind, for pictures."""

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.wind_kernels import trilinear_wind_at_points

# A step is this share of a cell; slower air than this is taken as still. Both chosen.
STEP_CELLS = 0.5
STILL_M_S = 1e-3


def streamlines(
    environment: Environment, seeds_m: NDArray[np.float64], *, max_length_m: float
) -> list[NDArray[np.float64]]:
    """Return the paths along the wind of the first frame from the seeds, each (n, 3) with n >= 2, world frame [m].

    Steps have equal lengths and go by the midpoint rule; a path ends in a solid, outside the grid, in still air, or at
    its greatest length.

    Args:
        environment: The room and its wind.
        seeds_m: (n, 3) where paths begin, world frame [m]; those outside the air have none.
        max_length_m: How long a path may become [m].
    """
    step_m = STEP_CELLS * environment.grid.cell_m
    points_m = np.asarray(seeds_m, dtype=np.float64).reshape(-1, 3)
    is_going = _is_air(environment, points_m)
    paths = [points_m]
    lengths = np.where(is_going, 1, 0)
    for _ in range(int(max_length_m / step_m)):
        middle_m = points_m + 0.5 * step_m * _direction(environment, points_m)
        direction = _direction(environment, middle_m)
        points_m = points_m + step_m * direction
        is_going &= direction.any(axis=1) & _is_air(environment, points_m)
        if not is_going.any():
            break
        paths.append(points_m)
        lengths += is_going
    track_m = np.stack(paths)
    return [track_m[:n, i] for i, n in enumerate(lengths) if n >= 2]


# Unit vectors along the wind, (n, 3); zero where it is still.
def _direction(environment: Environment, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    grid = environment.grid
    wind_m_s = trilinear_wind_at_points(environment.wind.velocity_m_s[0], grid.origin_m, grid.cell_m, points_m)
    speed_m_s = np.linalg.norm(wind_m_s, axis=1, keepdims=True)
    return np.where(speed_m_s > STILL_M_S, wind_m_s / np.maximum(speed_m_s, STILL_M_S), 0.0)


def _is_air(environment: Environment, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
    cells = environment.grid.cell_of(points_m)
    is_inside = environment.grid.contains_cell(cells)
    i, j, k = np.where(is_inside[:, None], cells, 0).T
    return is_inside & (environment.occupancy[i, j, k] != Cell.SOLID)
