"""Lengths of free paths to the sources of cases: what rewards are shaped by, in single searches and in batches."""

# pyright: basic
# ruff: noqa: ANN001, ANN202 - kernels have no types

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.paths.scoring_paths import Places, layer_at
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim_training.free_distances import compute_free_distances_m

# Actions that lead a vehicle in space, not at its search height.
_IN_SPACE = ("velocity_3d", "waypoint_3d")


@numba.njit(cache=True, nogil=True)
def _interpolate_inplace(lengths_m, values_m, firsts, shapes, grids_m, cases, places_m, distances_m):
    # Linearly between the centres of cells; beyond the outermost ones as at them.
    for n in range(len(cases)):
        k = cases[n]
        if firsts[k] < 0:
            lengths_m[n] = distances_m[n]
            continue
        found_m = 0.0
        for corner in range(8):
            weight, at = 1.0, 0
            for axis in range(3):
                last = shapes[k, axis] - 1
                inside = (places_m[n, axis] - grids_m[k, axis]) / grids_m[k, 3] - 0.5
                inside = min(max(inside, 0.0), float(last))
                low = int(inside)
                share = inside - low
                is_high = corner >> axis & 1
                weight *= share if is_high else 1.0 - share
                at = at * shapes[k, axis] + (min(low + 1, last) if is_high else low)
            if weight > 0.0:
                found_m += weight * values_m[firsts[k] + at]
        lengths_m[n] = max(found_m, distances_m[n])


class PathLengths:
    """Lengths of the shortest free paths from places to the nearest source, by case.

    A vehicle that stays at its search height goes around what is solid there; one that flies in space, around what is
    solid in the room. The level part and the rise to the source make a length, as the referee has it: without the rise
    where it judges the horizontal distance. Where nothing is solid a length is the straight distance.

    Lengths are computed at cells' centres and interpolated linearly; they are never below the straight distance.

    Args:
        action: The kind of actions.
    """

    def __init__(self, action: str) -> None:
        self._is_in_space = action in _IN_SPACE
        self._fields: list[NDArray[np.float32]] = []
        self._known: dict[tuple[object, ...], int] = {}
        self._n_values = 0
        self._rows: list[tuple[int, tuple[int, int, int], tuple[float, float, float], float]] = []
        self._joined: tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]] | None
        self._joined = None

    def add(self, scenario: Scenario, agent: AgentSpec, environment: Environment) -> None:
        """Add the case of a scenario: its number is how many were added before."""
        sources_m = tuple(source.position_m for source in scenario.gas.searched)
        is_level = bool(getattr(scenario.referee.success, "is_horizontal", False))
        height_m = agent.vehicle.search_height_m
        places: Places = environment if self._is_in_space else layer_at(environment, height_m)
        self._joined = None
        if not (places.occupancy == Cell.SOLID).any():
            self._rows.append((-1, (1, 1, 1), (0.0, 0.0, 0.0), 1.0))
            return
        key = (environment.content_hash, sources_m, is_level, height_m)
        if key not in self._known:
            lengths_m = np.full(places.occupancy.shape, np.inf, np.float32)
            for x_m, y_m, z_m in sources_m:
                rise_m = 0.0 if is_level or self._is_in_space else z_m - height_m
                found_m = compute_free_distances_m(places, (x_m, y_m, z_m if self._is_in_space else 0.0))
                if found_m is not None:
                    np.minimum(lengths_m, np.hypot(found_m, np.float32(rise_m)), out=lengths_m)
            self._known[key] = self._n_values if np.isfinite(lengths_m).all() else -1
            self._fields.append(lengths_m.ravel())
            self._n_values += lengths_m.size
        grid = places.grid
        self._rows.append((self._known[key], grid.shape, grid.origin_m, grid.cell_m))

    def lengths_m(
        self, cases: NDArray[np.int64], places_m: NDArray[np.float64], distances_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Return the lengths from places.

        Args:
            cases: The case of each place, (n,).
            places_m: Places, (n, 3), world frame [m].
            distances_m: Their straight distances to the nearest source, (n,) [m].

        Returns:
            (n,) [m].
        """
        if not self._n_values:
            return distances_m
        values_m, firsts, shapes, grids_m = self._joined = self._joined or self._join()
        lengths_m = np.empty(len(cases))
        _interpolate_inplace(lengths_m, values_m, firsts, shapes, grids_m, cases, places_m, distances_m)
        return lengths_m

    def _join(self) -> tuple[NDArray[np.float32], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        firsts, shapes, origins_m, cells_m = zip(*self._rows, strict=True)
        grids_m = np.column_stack([np.array(origins_m, np.float64), np.array(cells_m, np.float64)])
        return np.concatenate(self._fields), np.array(firsts, np.int64), np.array(shapes, np.int64), grids_m
