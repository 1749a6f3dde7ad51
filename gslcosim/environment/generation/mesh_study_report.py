"""Report of a mesh study: a table, a file for programs, and a plot where matplotlib is installed."""

import csv
import json
from pathlib import Path

import numpy as np

from gslcosim.environment.generation.mesh_study import Convergence, MeshStudy
from gslcosim.environment.grid import point_text
from gslcosim.flow.history_plot import matplotlib_figure_type

JSON_FILE, CSV_FILE, PLOT_FILE = "mesh_study.json", "mesh_study.csv", "mesh_study.png"


def build_rows(study: MeshStudy) -> list[list[str]]:
    """Return the rows of a table, the headings first: a row for each mesh, then those of the convergence."""
    names = [point_text(probe_m) for probe_m in study.probes_m]
    head = ["cell [m]", "wanted", "air cells", "seconds", *(f"{name} [m/s]" for name in names), "mean [m/s]"]
    rows = [
        [
            f"{run.cell_m:.4g}",
            f"{run.wanted_cell_m:g}",
            str(run.n_air_cells),
            f"{run.duration_s:.1f}",
            *(f"{speed_m_s:.4f}" for speed_m_s in (*run.probe_speeds_m_s, run.mean_speed_m_s)),
        ]
        for run in study.runs
    ]
    columns = (*study.probe_convergence, study.mean_convergence)
    return [
        head,
        *rows,
        ["observed order", "", "", "", *(_order_text(each) for each in columns)],
        ["without cells", "", "", "", *(_text(each.extrapolated, "{:.4f}") for each in columns)],
        ["finest within", "", "", "", *(_text(each.uncertainty_frac, "{:.1%}") for each in columns)],
    ]


def write_study(study: MeshStudy, folder: Path) -> list[Path]:
    """Write a study into a folder, which is made, and return the files written."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / JSON_FILE).write_text(json.dumps(study.as_fields(), indent=2), encoding="utf-8")
    with (folder / CSV_FILE).open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(build_rows(study))
    written = [folder / JSON_FILE, folder / CSV_FILE]
    return [*written, folder / PLOT_FILE] if _plot(study, folder / PLOT_FILE) else written


def _order_text(convergence: Convergence) -> str:
    if convergence.order is None:
        return "none"
    return f"{convergence.order:.2f}" + (" (oscillating)" if convergence.kind == "oscillating" else "")


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)


def _plot(study: MeshStudy, path: Path) -> bool:
    figure_type = matplotlib_figure_type()
    if figure_type is None:
        return False
    figure = figure_type(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    cells_m = [run.cell_m for run in study.runs]
    speeds = np.array([[*run.probe_speeds_m_s, run.mean_speed_m_s] for run in study.runs])
    names = [*(point_text(probe_m) for probe_m in study.probes_m), "mean of the air"]
    convergence = (*study.probe_convergence, study.mean_convergence)
    for name, series, found in zip(names, speeds.T, convergence, strict=True):
        (line,) = axes.plot(cells_m, series, "o-", label=name)
        if found.extrapolated is not None:
            axes.plot([0.0], [found.extrapolated], "x", color=line.get_color())
    axes.set(xlabel="cell [m]", ylabel="speed [m/s]", xlim=(-0.01, None), ylim=(0.0, None))
    axes.set_title("Winds on several meshes; crosses: extrapolated to no cells")
    axes.legend(loc="best")
    figure.savefig(path, dpi=120)
    return True
