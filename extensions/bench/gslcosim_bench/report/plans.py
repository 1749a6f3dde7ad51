"""Plans of the rooms of a report as pictures: what is solid and how much gas there was, for pages to draw on."""

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base.untrusted_input import JsonObject, parse_json
from gslcosim_bench.report.curves import rows_by_entry
from gslcosim_bench.report.report_data import EnvironmentMap, Floats, Ints, ReportData
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.rates import wilson

_MOST_CELLS = 120
_SOLID, _MOST_GAS = 255, 250
# Gas fainter than the greatest by this factor is left blank.
_DECADES = 2.5
_SOLID_RGBA, _GAS_RGB, _GAS_OPACITY = (128, 129, 126, 205), (205, 155, 35), 0.82


@dataclass(frozen=True, kw_only=True)
class PlanPicture:
    """Picture of a plan: (nx, ny) bytes, 255 solid, else how much gas there is, 0 to 250 on a logarithmic scale.

    `origin_m` is the corner of the first cell and `extent_m` its size [m]; `greatest_ppm` is 0 without gas.
    """

    cells: NDArray[np.uint8]
    origin_m: tuple[float, float]
    extent_m: tuple[float, float]
    greatest_ppm: float

    def draw(self, *, with_gas: bool = True) -> Image.Image:
        """Return the picture, y up, in colours on a transparent ground: a byte is the number of a colour."""
        cells = self.cells if with_gas else np.where(self.cells == _SOLID, self.cells, 0).astype(np.uint8)
        image = Image.fromarray(np.ascontiguousarray(cells.T[::-1]), mode="P")
        image.putpalette([part for level in range(256) for part in (_GAS_RGB if level < 255 else _SOLID_RGBA[:3])])
        image.info["transparency"] = bytes([*(round(_GAS_OPACITY * level) for level in range(255)), _SOLID_RGBA[3]])
        return image

    def to_png(self, *, with_gas: bool = True) -> bytes:
        """Return the picture as a PNG."""
        file = io.BytesIO()
        self.draw(with_gas=with_gas).save(file, format="PNG", optimize=True)
        return file.getvalue()


def shade(plan: EnvironmentMap) -> PlanPicture:
    """Return the picture of a plan, of at most 120 cells to a side."""
    every = max(1, -(-max(plan.occupied.shape) // _MOST_CELLS))
    level = np.zeros(())
    gas_ppm = np.zeros(()) if plan.mean_gas_ppm is None else _blocks(np.nan_to_num(plan.mean_gas_ppm), every)
    greatest_ppm = float(gas_ppm.max(initial=0.0))
    if greatest_ppm > 0.0:
        decades = np.log10(np.maximum(gas_ppm / greatest_ppm, 1e-12)) / _DECADES
        level = np.round(_MOST_GAS * np.clip(1.0 + decades, 0.0, 1.0))
    cells = np.where(_blocks(plan.occupied.astype(np.float64), every) >= 0.5, _SOLID, level).astype(np.uint8)
    nx, ny = cells.shape
    return PlanPicture(
        cells=cells,
        origin_m=plan.origin_m,
        extent_m=(nx * every * plan.cell_m, ny * every * plan.cell_m),
        greatest_ppm=greatest_ppm,
    )


# Mean over blocks of cells; what is left over at the far sides makes smaller blocks.
def _blocks(values: Floats, every: int) -> Floats:
    for axis in (0, 1):
        starts = np.arange(0, values.shape[axis], every)
        widths = np.diff(np.append(starts, values.shape[axis]))
        values = np.add.reduceat(values, starts, axis=axis) / (widths[:, None] if axis == 0 else widths)
    return values


@dataclass(frozen=True, kw_only=True)
class PlanDrawing:
    """A room to draw on: `rows` are the runs in it, and `box_m` is what is shown, (x0, y0, x1, y1) [m].

    `plan` and its `picture` are None where the results have no map of it.
    """

    scenario: str
    label: str
    box_m: tuple[float, float, float, float]
    sources_m: tuple[tuple[float, float], ...]
    rows: Ints
    plan: EnvironmentMap | None = None
    picture: PlanPicture | None = None


@dataclass(frozen=True, kw_only=True)
class StartSuccess:
    """Success of an entry from one start of an environment."""

    room: int
    entry: int
    x_m: float
    y_m: float
    success: Estimate


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


def _mapped(label: str, plan: EnvironmentMap, some: Ints) -> PlanDrawing:
    (x0, y0), (nx, ny) = plan.origin_m, plan.occupied.shape
    return PlanDrawing(
        scenario=plan.scenario, label=label, box_m=(x0, y0, x0 + nx * plan.cell_m, y0 + ny * plan.cell_m),
        sources_m=tuple((x, y) for x, y, _ in plan.sources_m), rows=some, plan=plan, picture=shade(plan),
    )  # fmt: skip


def _bare(material: ReportData, label: str, some: Ints) -> PlanDrawing:
    rows = material.rows
    sources = {(float(x), float(y)) for x, y in zip(rows["source_x_m"][some], rows["source_y_m"][some])}
    sources = {place for place in sources if all(np.isfinite(place))}
    starts = np.stack([rows["start_x_m"][some], rows["start_y_m"][some]], axis=1)
    places = np.concatenate([starts[np.isfinite(starts).all(axis=1)], np.array(list(sources)).reshape(-1, 2)])
    low, high = (places.min(0) - 2.0, places.max(0) + 2.0) if places.size else (np.zeros(2), np.ones(2))
    return PlanDrawing(
        scenario=str(rows["scenario"][some[0]]), label=label, rows=some, sources_m=tuple(sorted(sources)),
        box_m=(float(low[0]), float(low[1]), float(high[0]), float(high[1])),
    )  # fmt: skip


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
