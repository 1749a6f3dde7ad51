"""What makes a case difficult: its geometry, how soon gas is met, the way, the plume and the wind (D1 to D5)."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gslcosim.benchmark.report.reading import Flags, Floats, Ints, Material, RoomMap
from gslcosim.benchmark.report.rooms import DrawnRoom
from gslcosim.benchmark.statistics.difficulty import (
    contact_difficulty,
    distance_difficulty,
    geometric_difficulty,
    plume_legibility,
    wind_difficulty,
)

BLIND, SWEEP = "persistent_walk", "sweep"
"""The entries whose flights tell of geometry and of contact with gas: the bundled methods under their own names."""


@dataclass(frozen=True, kw_only=True)
class Causes:
    """What makes a case difficult, each dimensionless; nan where what it is told by was not flown or not drawn.

    Attributes:
        geometry: D1, how rarely the persistent walk finds the source.
        contact: D2, how rarely the sweep meets gas in the first third of the time.
        distance: D3, the shortest way over the diagonal of the room.
        legibility: D4, how plainly the plume points to its source; high is easy.
        wind: D5, how much the wind's direction differs along the oracle's way and over time.
    """

    geometry: float
    contact: float
    distance: float
    legibility: float
    wind: float


def causes_of(material: Material, rooms: Sequence[DrawnRoom], cells: Ints) -> list[Causes]:
    """Return what makes each case difficult.

    Args:
        material: What was flown.
        rooms: The rooms that it was flown in.
        cells: (n,) indices of the cases, as in `rows.cells`.
    """
    rows = material.rows
    index = {entry.name: i for i, entry in enumerate(material.entries)}
    maps = _map_of_rows(rooms)
    ways = _ways_of(material, material.index_of_anchor("lower"))
    found: list[Causes] = []
    for cell in cells.tolist():
        flown = np.flatnonzero((rows.cells == cell) & ~rows.is_control)
        blind, sweep = (flown[rows.entry[flown] == index.get(name, -1)] for name in (BLIND, SWEEP))
        plan = next((maps[row] for row in flown.tolist() if row in maps), None)
        found.append(
            Causes(
                geometry=geometric_difficulty(float(rows["success"][blind].mean())) if blind.size else math.nan,
                contact=_contact(material, sweep),
                distance=_distance(shortest_path_m(material, flown), plan),
                legibility=_legibility(plan) if plan else math.nan,
                wind=_wind(plan, [ways[row] for row in flown.tolist() if row in ways]) if plan else math.nan,
            )
        )
    return found


def _contact(material: Material, sweep: Ints) -> float:
    if not sweep.size:
        return math.nan
    rows = material.rows
    return contact_difficulty(rows["first_contact_s"][sweep], float(rows["time_limit_s"][sweep[0]]))


def shortest_path_m(material: Material, flown: Ints) -> float:
    """Return the shortest way of the flights of one case [m]: equal for all, nan where none has a result."""
    ways_m = material.rows["shortest_path_m"][flown]
    known_m = ways_m[np.isfinite(ways_m)]
    return float(known_m[0]) if known_m.size else math.nan


def _distance(shortest_m: float, plan: RoomMap | None) -> float:
    return distance_difficulty(shortest_m, plan.cell_m * math.hypot(*plan.occupied.shape)) if plan else math.nan


def _map_of_rows(rooms: Sequence[DrawnRoom]) -> dict[int, RoomMap]:
    return {
        row: room.plan
        for room in rooms
        if room.plan is not None
        for row in room.rows.tolist()
    }  # fmt: skip


# The ways of an entry, (m, 2) each, world frame [m], by row.
def _ways_of(material: Material, entry: int | None) -> Mapping[int, Floats]:
    if material.tracks is None or entry is None:
        return {}
    rows = material.rows
    wanted = {str(rows["trial"][row]): row for row in np.flatnonzero(rows.entry == entry).tolist()}
    found: dict[int, Floats] = {}
    for batch in material.tracks.select(["trial", "x_m", "y_m"]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            if trial in wanted:
                xy_m = np.stack([np.asarray(batch.column(i)[k].values, dtype=np.float64) for i in (1, 2)], axis=1)
                found[wanted[trial]] = xy_m[np.isfinite(xy_m).all(axis=1)]
    return found


def _wind(plan: RoomMap, ways: Sequence[Floats]) -> float:
    if plan.wind_toward is None or not ways:
        return math.nan
    cells = np.unique(np.concatenate([_cells_of(plan, way) for way in ways]), axis=0)
    return wind_difficulty(plan.wind_toward[cells[:, 0], cells[:, 1]])


# Where a robot waits its cell is counted once.
def _cells_of(plan: RoomMap, way_m: Floats) -> Ints:
    cells = np.floor((way_m - plan.origin_m) / plan.cell_m).astype(np.int64)
    return np.clip(cells, 0, np.array(plan.occupied.shape) - 1)


def _legibility(plan: RoomMap) -> float:
    if plan.mean_gas_ppm is None or plan.intermittency is None or plan.wind_toward is None:
        return math.nan
    axis = _axis_of(plan)
    against = -plan.wind_toward[axis[:, 0], axis[:, 1]]
    # One cell to each side, along the nearest of eight directions; where the wind has none there is no upwind.
    turn = np.round(np.arctan2(against[:, 1], against[:, 0]) / (0.25 * math.pi)) * (0.25 * math.pi)
    step = np.where(np.hypot(*against.T)[:, None] > 0, np.round(np.stack([np.cos(turn), np.sin(turn)], axis=1)), 0)
    before, after = axis + step.astype(np.int64), axis - step.astype(np.int64)
    seen = _is_air(plan, before) & _is_air(plan, after) & (step != 0).any(axis=1)
    upwind, downwind = plan.mean_gas_ppm[tuple(before[seen].T)], plan.mean_gas_ppm[tuple(after[seen].T)]
    gas_free = 1.0 - plan.intermittency[tuple(axis[seen].T)]
    return plume_legibility((upwind - downwind) / (2.0 * plan.cell_m), gas_free)


# The cell with the most gas in each ring around the source, as long as there is some.
def _axis_of(plan: RoomMap) -> Ints:
    assert plan.mean_gas_ppm is not None
    nx, ny = plan.occupied.shape
    x_m, y_m = (origin + (np.arange(n) + 0.5) * plan.cell_m for origin, n in zip(plan.origin_m, (nx, ny), strict=True))
    gaps_m = [np.hypot(x_m[:, None] - x, y_m[None, :] - y) for x, y, _ in plan.sources_m]
    ring = np.floor(np.min(gaps_m, axis=0) / plan.cell_m).astype(np.int64)
    gas_ppm = np.where(plan.occupied, 0.0, np.nan_to_num(plan.mean_gas_ppm))
    order = np.lexsort((-gas_ppm.reshape(-1), ring.reshape(-1)))
    first = order[np.unique(ring.reshape(-1)[order], return_index=True)[1]]
    axis = np.stack(np.unravel_index(first, (nx, ny)), axis=1)
    return axis[gas_ppm[tuple(axis.T)] > 0.0]


def _is_air(plan: RoomMap, cells: Ints) -> Flags:
    inside = np.all((cells >= 0) & (cells < np.array(plan.occupied.shape)), axis=1)
    safe = np.where(inside[:, None], cells, 0)
    return inside & ~plan.occupied[safe[:, 0], safe[:, 1]]
