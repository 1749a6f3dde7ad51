"""Environments as records for the kernels, each once."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.boxes import solid_boxes
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.training.batch import batch_records as records
from gslcosim_services.fields.concentration.mixing_ratio import build_solid_sums
from gslcosim_services.sensing.ray_scene import BIN_M, RayScene

# Edge of the blocks in which the boxes are looked for that a vehicle may touch [m].
_BLOCK_M = 0.5
# What rounding may add to a vehicle's reach [m].
_ROUNDING_M = 1e-6


@dataclass
class BatchRooms:
    """Rooms by what decides them; `kept` holds the arrays that the records point into."""

    rows: list[NDArray[np.void]] = field(default_factory=list[NDArray[np.void]])
    kept: list[object] = field(default_factory=list[object])
    _known: dict[tuple[str, float], int] = field(default_factory=dict[tuple[str, float], int])

    def number_of(self, scenario: Scenario, environment: Environment, radius_m: float) -> int:
        """Return the number of a scenario's room for vehicles of a radius [m]."""
        key = (environment.content_hash, radius_m)
        if key not in self._known:
            self._known[key] = len(self.rows)
            self.rows.append(self._row(environment, radius_m))
            self._fill_rays(self.rows[-1], RayScene(scenario, environment))
        return self._known[key]

    def array(self) -> NDArray[np.void]:
        """Return the (n,) records of `ROOM`."""
        return np.array(self.rows, records.ROOM)

    def _row(self, environment: Environment, radius_m: float) -> NDArray[np.void]:
        row = np.zeros((), records.ROOM)
        grid, wind = environment.grid, environment.wind
        row["origin_m"], row["max_m"], row["cell_m"], row["shape"] = grid.origin_m, grid.max_m, grid.cell_m, grid.shape
        row["occupancy"] = self._address(np.ascontiguousarray(environment.occupancy, np.uint8))
        row["wind"] = self._address(np.ascontiguousarray(wind.velocity_m_s, np.float32))
        row["wind_shape"] = wind.velocity_m_s.shape[:4]
        row["wind_period_s"], row["wind_loops"] = wind.period_s, wind.is_looping
        boxes_m = np.array([(*box.min_m, *box.max_m) for box in solid_boxes(environment)], np.float64)
        row["boxes_m"], row["n_boxes"] = self._address(boxes_m), len(boxes_m)
        first, members, shape = _near(boxes_m, np.array(grid.origin_m), np.array(grid.max_m), radius_m)
        row["near_origin_m"], row["near_block_m"], row["near_shape"] = grid.origin_m, _BLOCK_M, shape
        row["near_first"], row["near_members"] = self._address(first), self._address(members)
        row["solid_sums"] = self._address(build_solid_sums(np.ascontiguousarray(environment.occupancy, np.uint8)))
        return row

    def _fill_rays(self, row: NDArray[np.void], rays: RayScene) -> None:
        boxes_m, first, members = rays.boxes
        row["ray_boxes_m"], row["n_ray_boxes"] = self._address(boxes_m), len(boxes_m)
        row["ray_first"], row["ray_members"] = self._address(first), self._address(members)
        row["ray_origin_m"], row["ray_shape"] = rays.bins
        row["ray_bin_m"] = BIN_M

    def _address(self, array: NDArray) -> int:
        self.kept.append(array)
        return int(array.ctypes.data)


# Which boxes are within reach of a vehicle somewhere in each block, as first and members.
def _near(
    boxes_m: NDArray[np.float64], low_m: NDArray[np.float64], high_m: NDArray[np.float64], radius_m: float
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
    shape = np.maximum(np.ceil((high_m - low_m) / _BLOCK_M).astype(np.int64), 1)
    reach_m = radius_m + _ROUNDING_M
    blocks: list[NDArray[np.int64]] = []
    members: list[NDArray[np.int32]] = []
    for n, box_m in enumerate(boxes_m):
        begin = np.clip(np.floor((box_m[:3] - reach_m - low_m) / _BLOCK_M).astype(np.int64), 0, shape)
        end = np.clip(np.floor((box_m[3:] + reach_m - low_m) / _BLOCK_M).astype(np.int64) + 1, 0, shape)
        i, j, k = (np.arange(a, b) for a, b in zip(begin.tolist(), end.tolist(), strict=True))
        inside = ((i[:, None, None] * shape[1] + j[None, :, None]) * shape[2] + k[None, None, :]).ravel()
        blocks.append(inside)
        members.append(np.full(len(inside), n, np.int32))
    all_blocks, all_members = np.concatenate(blocks), np.concatenate(members)
    order = np.argsort(all_blocks, kind="stable")
    n_blocks = int(np.prod(shape))
    first = np.zeros(n_blocks + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(all_blocks, minlength=n_blocks))
    return first, np.ascontiguousarray(all_members[order]), shape
