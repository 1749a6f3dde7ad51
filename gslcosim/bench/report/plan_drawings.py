"""Drawings over the plans of environments: success by start, and tracks."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.untrusted_json import JsonObject, parse_json
from gslcosim.bench.report.curves import rows_by_entry
from gslcosim.bench.report.report_data import EnvironmentMap, Floats, Ints, ReportData
from gslcosim.bench.statistics.estimates import Estimate
from gslcosim.bench.statistics.rates import wilson

QUANTUM_M = 0.02
"""Resolution of the tracks on the page [m]."""

_MOST_CELLS = 120
_MOST_POINTS = 110
_MOST_TRACKS = 900
_MOST_OF_AN_ENTRY = 36
_MOST_OF_A_TEAM = 10
_SOLID, _MOST_GAS = 255, 250
# Gas fainter than the greatest by this factor is left blank.
_DECADES = 2.5


@dataclass(frozen=True, kw_only=True)
class PlanDrawing:
    """A plan to draw on: (nx, ny) bytes, 255 solid, else how much gas there is, 0 to 250 on a logarithmic scale.

    `rows` are the runs in it; `plan` is the map it was drawn from, if there is one; `box_m` is what is shown,
    (x0, y0, x1, y1) [m]. `greatest_ppm` is 0 without gas.
    """

    scenario: str
    label: str
    origin_m: tuple[float, float]
    extent_m: tuple[float, float]
    box_m: tuple[float, float, float, float]
    cells: NDArray[np.uint8] | None
    greatest_ppm: float
    height_m: float | None
    sources_m: tuple[tuple[float, float], ...]
    rows: Ints
    plan: EnvironmentMap | None


@dataclass(frozen=True, kw_only=True)
class StartSuccess:
    """Success of an entry from one start of an environment."""

    room: int
    entry: int
    x_m: float
    y_m: float
    success: Estimate


@dataclass(frozen=True, kw_only=True)
class DrawnTrack:
    """The way of an agent: (m, 2) steps of `QUANTUM_M`, the first from the origin."""

    room: int
    row: int
    steps: Ints


def build_plan_drawings(material: ReportData) -> tuple[PlanDrawing, ...]:
    """Return the rooms that were run in; those without a map are the box around starts and sources."""
    rows, rooms = material.rows, list[PlanDrawing]()
    for scenario in dict.fromkeys(rows["scenario"].tolist()):
        here = np.flatnonzero(rows["scenario"] == scenario)
        maps = [room for room in material.maps if room.scenario == scenario]
        parts = _parts(rows["varied"], here, maps) if maps else [(None, here)]
        many = len(parts) > 1
        for i, (room, some) in enumerate(parts):
            label = f"{scenario} {i + 1}" if many else scenario
            rooms.append(_mapped(label, room, some) if room else _bare(material, label, some))
    return tuple(rooms)


# The rows of each map: those whose values hold the map's.
def _parts(varied: Floats, here: Ints, maps: Sequence[EnvironmentMap]) -> list[tuple[EnvironmentMap | None, Ints]]:
    values = [parse_json(text or "{}", JsonObject, place="trials: varied") for text in varied[here]]
    wanted = [parse_json(room.varied, JsonObject, place="maps.json: varied") for room in maps]
    place = [
        next((k for k, want in enumerate(wanted) if all(value.get(key) == want[key] for key in want)), 0)
        for value in values
    ]
    parts = [(room, here[np.array(place) == k]) for k, room in enumerate(maps)]
    return [(room, some) for room, some in parts if some.size]


def _mapped(label: str, room: EnvironmentMap, some: Ints) -> PlanDrawing:
    cells, cell_m, greatest = _packed(room)
    nx, ny = cells.shape
    x0, y0 = room.origin_m
    return PlanDrawing(
        scenario=room.scenario, label=label, origin_m=room.origin_m, extent_m=(nx * cell_m, ny * cell_m),
        box_m=(x0, y0, x0 + room.occupied.shape[0] * room.cell_m, y0 + room.occupied.shape[1] * room.cell_m),
        cells=cells, greatest_ppm=greatest, height_m=room.height_m,
        sources_m=tuple((x, y) for x, y, _ in room.sources_m), rows=some, plan=room,
    )  # fmt: skip


def _bare(material: ReportData, label: str, some: Ints) -> PlanDrawing:
    rows = material.rows
    sources = {(float(x), float(y)) for x, y in zip(rows["source_x_m"][some], rows["source_y_m"][some])}
    sources = {place for place in sources if all(np.isfinite(place))}
    starts = np.stack([rows["start_x_m"][some], rows["start_y_m"][some]], axis=1)
    places = np.concatenate([starts[np.isfinite(starts).all(axis=1)], np.array(list(sources)).reshape(-1, 2)])
    low, high = (places.min(0) - 2.0, places.max(0) + 2.0) if places.size else (np.zeros(2), np.ones(2))
    return PlanDrawing(
        scenario=str(rows["scenario"][some[0]]), label=label, origin_m=(float(low[0]), float(low[1])),
        extent_m=(float(high[0] - low[0]), float(high[1] - low[1])),
        box_m=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        cells=None, greatest_ppm=0.0, height_m=None, sources_m=tuple(sorted(sources)), rows=some, plan=None,
    )  # fmt: skip


def _packed(room: EnvironmentMap) -> tuple[NDArray[np.uint8], float, float]:
    every = max(1, -(-max(room.occupied.shape) // _MOST_CELLS))
    solid = _blocks(room.occupied.astype(np.float64), every) >= 0.5
    if room.mean_gas_ppm is None:
        return np.where(solid, _SOLID, 0).astype(np.uint8), room.cell_m * every, 0.0
    gas = _blocks(np.nan_to_num(room.mean_gas_ppm), every)
    greatest = float(gas.max(initial=0.0))
    if greatest <= 0.0:
        return np.where(solid, _SOLID, 0).astype(np.uint8), room.cell_m * every, 0.0
    decades = np.log10(np.maximum(gas / greatest, 1e-12)) / _DECADES
    level = np.round(_MOST_GAS * np.clip(1.0 + decades, 0.0, 1.0))
    return np.where(solid, _SOLID, level).astype(np.uint8), room.cell_m * every, greatest


# Mean over blocks of cells; what is left over at the far sides makes smaller blocks.
def _blocks(values: Floats, every: int) -> Floats:
    if every == 1:
        return values
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], every)
        widths = np.diff(np.append(starts, values.shape[axis]))
        values = np.add.reduceat(values, starts, axis=axis) / (widths[:, None] if axis == 0 else widths)
    return values


def compute_start_success(material: ReportData, rooms: Sequence[PlanDrawing]) -> tuple[StartSuccess, ...]:
    """Return the success of each entry from each start in each room."""
    rows, found = material.rows, list[StartSuccess]()
    everything = np.ones(len(rows), dtype=bool)
    for entry, flown in rows_by_entry(material, everything):
        for i, room in enumerate(rooms):
            some = np.intersect1d(flown, room.rows)
            places = np.round(np.stack([rows["start_x_m"][some], rows["start_y_m"][some]], axis=1), 2)
            if not some.size or not np.isfinite(places).all():
                continue
            starts, place = np.unique(places, axis=0, return_inverse=True)
            for k, (x_m, y_m) in enumerate(starts.tolist()):
                success = rows["success"][some[place.reshape(-1) == k]]
                rate = wilson(int(success.sum()), success.size)
                found.append(StartSuccess(room=i, entry=entry, x_m=x_m, y_m=y_m, success=rate))
    return tuple(found)


def select_tracks(material: ReportData, rooms: Sequence[PlanDrawing]) -> tuple[DrawnTrack, ...]:
    """Return some tracks of each entry in each room, thinned: as many of each as fit on a page of bounded size."""
    if material.tracks is None:
        return ()
    rows = material.rows
    everything = rows_by_entry(material, np.ones(len(rows), dtype=bool))
    each = max(2, min(_MOST_OF_AN_ENTRY, _MOST_TRACKS // max(1, len(rooms) * len(everything))))
    wanted: dict[str, tuple[int, int]] = {}
    for i, room in enumerate(rooms):
        for _, flown in everything:
            some = np.intersect1d(flown, room.rows)
            picked = some[np.unique(np.linspace(0, some.size - 1, min(each, some.size)).round().astype(int))]
            wanted |= {str(rows["trial"][row]): (i, int(row)) for row in picked.tolist()}
    return tuple(_tracks(material, wanted))


def _tracks(material: ReportData, wanted: Mapping[str, tuple[int, int]]) -> list[DrawnTrack]:
    found: dict[str, list[DrawnTrack]] = {}
    assert material.tracks is not None
    for batch in material.tracks.select(["trial", "x_m", "y_m"]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            # A team has a row for each robot.
            if trial in wanted and len(found.get(trial, ())) < _MOST_OF_A_TEAM:
                xy_m = np.stack([np.asarray(batch.column(i)[k].values, dtype=np.float64) for i in (1, 2)], axis=1)
                xy_m = xy_m[np.isfinite(xy_m).all(axis=1)]
                if len(xy_m) > 1:
                    room, row = wanted[trial]
                    found.setdefault(trial, []).append(DrawnTrack(room=room, row=row, steps=_thinned(xy_m)))
    return [track for trial in wanted for track in found.get(trial, ())]


def _thinned(xy_m: Floats) -> Ints:
    keep = np.unique(np.linspace(0, len(xy_m) - 1, min(_MOST_POINTS, len(xy_m))).round().astype(int))
    places = np.round(xy_m[keep] / QUANTUM_M).astype(np.int64)
    moved = np.concatenate([[True], (np.diff(places, axis=0) != 0).any(axis=1)])
    return np.diff(places[moved], axis=0, prepend=np.zeros((1, 2), dtype=np.int64))


def encode_plan(cells: NDArray[np.uint8]) -> str:
    """Return the bytes of a plan as text, in C order."""
    return base64.b64encode(np.ascontiguousarray(cells).tobytes()).decode()
