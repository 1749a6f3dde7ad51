"""Figures of results for papers: distances of all flights as bundles, and success by start over the plan."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.benchmark.report.curves import flights
from gslcosim.benchmark.report.reading import Ints, Material, read_material
from gslcosim.benchmark.report.rooms import DrawnRoom, rooms_of, starts_of
from gslcosim.errors import UsageError
from gslcosim.plotting.over_time import distance_bundle
from gslcosim.plotting.plans import success_by_start
from gslcosim.plotting.style import DASHES, FAINT, INK, look, new_figure, safe_text, save, styled

RESULT_FIGURES = ("distance", "starts")
_MOST_ENTRIES = 6
_MOST_ACROSS = {1: 2, 2: 3}


def write_result_figures(
    results: Path, folder: Path, *, names: Sequence[str] = (), formats: Sequence[str] = ("pdf",), columns: int = 1
) -> list[Path]:
    """Write figures of results, for each room: of the first six entries; return their files.

    Raises:
        UsageError: it is no folder of results, a named figure does not exist or has no data, or there is no matplotlib.
        MachineError: a file cannot be written.
    """
    unknown = next((name for name in names if name not in RESULT_FIGURES), None)
    if unknown is not None:
        raise UsageError(f"--figure: expected some of {', '.join(RESULT_FIGURES)} for results, was '{unknown}'.")
    material = read_material(results)
    if "distance" in names and material.tracks is None:
        raise UsageError(f"--figure distance: expected results with tracks.parquet, {results} has none.")
    written: list[Path] = []
    with styled():
        for room in rooms_of(material):
            label = room.label.replace(" ", "_")
            if "starts" in (names or RESULT_FIGURES):
                figure = new_figure(columns, _starts_aspect(material, room, columns))
                _starts(figure, material, room, columns)
                written += save(figure, folder / f"starts_{label}", formats)
            if "distance" in (names or RESULT_FIGURES) and material.tracks is not None:
                figure = new_figure(columns, 0.85 if columns == 1 else 0.45)
                _distances(figure, material, room)
                written += save(figure, folder / f"distance_{label}", formats)
    return written


def _entries(material: Material, room: DrawnRoom) -> list[tuple[int, Ints]]:
    everything = np.ones(len(material.rows), dtype=bool)
    found = [(entry, np.intersect1d(flown, room.rows)) for entry, flown in flights(material, everything)]
    return [(entry, some) for entry, some in found if some.size][:_MOST_ENTRIES]


def _shape(material: Material, room: DrawnRoom, columns: int) -> tuple[int, int]:
    n = max(1, len(_entries(material, room)))
    across = min(n, _MOST_ACROSS[columns])
    return -(-n // across), across


def _starts_aspect(material: Material, room: DrawnRoom, columns: int) -> float:
    down, across = _shape(material, room, columns)
    x0, y0, x1, y1 = room.box_m
    return min((y1 - y0) / max(x1 - x0, 1e-9) * down / across + 0.1 * down, 2.0)


def _starts(figure: Any, material: Material, room: DrawnRoom, columns: int) -> None:
    panels = np.atleast_1d(figure.subplots(*_shape(material, room, columns), squeeze=False)).ravel()
    found = starts_of(material, [room])
    entries = _entries(material, room)
    solid = None if room.plan is None else (room.plan.occupied, room.plan.origin_m, room.plan.cell_m)
    for axes, (entry, _) in zip(panels, entries, strict=False):
        of_entry = [start for start in found if start.entry == entry]
        x0, y0, x1, y1 = room.box_m
        axes.set(xlim=(x0, x1), ylim=(y0, y1))
        success_by_start(
            axes,
            np.array([(start.x_m, start.y_m) for start in of_entry]),
            np.array([start.success.value for start in of_entry]),
            np.array([start.success.n for start in of_entry]),
            solid=solid,
            sources_m=np.array(room.sources_m),
            gid=f"starts/{material.entries[entry].name}",
        )
        axes.set(xlim=(x0, x1), ylim=(y0, y1))
        axes.set_title(safe_text(material.entries[entry].name), loc="left")
        axes.label_outer()
    for axes in panels[len(entries) :]:
        axes.set_visible(False)


def _distances(figure: Any, material: Material, room: DrawnRoom) -> None:
    curves = _curves(material, room)
    axes = figure.subplots()
    radii = {float(radius_m) for radius_m in material.rows["within_m"][room.rows]}
    bundles = {material.entries[entry].name: curves[entry] for entry, _ in _entries(material, room) if entry in curves}
    # As in the report.
    anchors = {"lower": {"color": INK, "ls": DASHES[1]}, "upper": {"color": FAINT, "ls": DASHES[1]}}
    looks = {entry.name: anchors[entry.anchor] for entry in material.entries if entry.anchor}
    others = [name for name in bundles if name not in looks]
    looks |= {name: look(i) for i, name in enumerate(others)}
    distance_bundle(axes, bundles, radius_m=radii.pop() if len(radii) == 1 else None, looks=looks)
    axes.set_title(safe_text(room.label), loc="left")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=1, handlelength=2.2)


# Of a team the nearest member at each time.
def _curves(material: Material, room: DrawnRoom) -> dict[int, list[Any]]:
    assert material.tracks is not None
    rows = material.rows
    wanted = {str(rows["trial"][row]): int(row) for _, some in _entries(material, room) for row in some.tolist()}
    found: dict[str, Any] = {}
    for batch in material.tracks.select(["trial", "t_s", "distance_m"]).to_batches(max_chunksize=512):
        for k, trial in enumerate(batch.column(0).to_pylist()):
            if trial not in wanted:
                continue
            t_s, distance_m = (np.asarray(batch.column(i)[k].values, dtype=np.float64) for i in (1, 2))
            if trial in found:
                n = min(len(t_s), len(found[trial][0]))
                t_s, distance_m = t_s[:n], np.minimum(distance_m[:n], found[trial][1][:n])
            found[trial] = (t_s, distance_m)
    curves: dict[int, list[Any]] = {}
    for trial, curve in found.items():
        if len(curve[0]):
            curves.setdefault(int(rows.entry[wanted[trial]]), []).append(curve)
    return curves
