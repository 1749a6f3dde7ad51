"""Mesh study: an environment solved on several meshes, and by OpenFOAM too, with a report."""

import csv
import json
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.generation.cache import recipe as plain_recipe
from gslcosim.environment.generation.wind import Progress, build_patches, no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.grid_kernels import trilinear_wind_at_points
from gslcosim.environment.layouts.layouts import build_layout
from gslcosim.environment.model import Cell, Environment, WindFrames, point_text, raise_if_any, with_wind
from gslcosim.environment.positions import find_point_problems
from gslcosim.scenario.models.geometry import Layout
from gslcosim.scenario.models.wind import WindSpec
from gslcosim_formats.environment_views import save_with_views
from gslcosim_formats.recipes import Recipe
from gslcosim_formats.solver_comparison import SolverComparison, compare_solvers
from gslcosim_formats.wind_plots import matplotlib_figure_type

# A safety factor of three or more meshes, Roache 1994.
SAFETY = 1.25
MAX_ORDER = 20.0
# Where the room is looked at unless set otherwise, as shares of its size: before, between and behind, and high up.
DEFAULT_PROBES_FRAC = ((0.2, 0.1, 0.25), (0.2, 0.8, 0.25), (0.8, 0.2, 0.25), (0.8, 0.9, 0.25), (0.5, 0.5, 0.75))
# Of the meshes wanted, how far one may be off for its cells to divide the room.
_MM = 1000
STUDY_JSON_FILE, STUDY_CSV_FILE, STUDY_PLOT_FILE = "mesh_study.json", "mesh_study.csv", "mesh_study.png"
COMPARISON_FILE = "solver_comparison.json"
# Compared where the scenario has no end of its own: what GSL-Bench takes for its wind.
DEFAULT_END_S = 5.0


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """Convergence of three values on finer and finer meshes.

    `kind` is `monotone`, `oscillating`, or `none` where the finer change is not the smaller one.
    `order` is the observed order of accuracy; `extrapolated` the value that an infinitely fine mesh would give;
    `uncertainty_frac` the grid convergence index of the finest mesh, relative to its value. The three are absent
    where there is no convergence, the last two also where values oscillate.
    """

    kind: str
    order: float | None = None
    extrapolated: float | None = None
    uncertainty_frac: float | None = None


def compute_convergence(cells_m: Sequence[float], values: Sequence[float]) -> Convergence:
    """Return the convergence of the values on the three finest meshes.

    |e32 / e21| = r21^p (r32^p - 1) / (r21^p - 1)         p the order
    extrapolated = (r21^p f1 - f2) / (r21^p - 1)
    uncertainty = 1.25 |(f1 - f2) / f1| / (r21^p - 1)

    f1 is the value on the finest mesh, e21 = f2 - f1, r21 = h2 / h1: all ratios are without dimension.

    Args:
        cells_m: Three or more edges of cells [m], any order.
        values: What each mesh gives, any unit.

    Source:
        Roache 1994, doi:10.1115/1.2910291; Celik and others 2008, doi:10.1115/1.2960953.
    Deviation:
        The equation for p is solved by bisection: the fixed-point iteration of the latter does not always end.
    Held by:
        tests/unit/environment/generation/test_convergence.py
    """
    meshes = sorted(zip(cells_m, values, strict=True))[:3]
    if len(meshes) < 3:
        return Convergence(kind="none")
    (h1, f1), (h2, f2), (h3, f3) = meshes
    e21, e32 = f2 - f1, f3 - f2
    if e21 == 0.0 or e32 == 0.0:
        return Convergence(kind="none")
    kind = "monotone" if e32 / e21 > 0 else "oscillating"
    order = _order(h2 / h1, h3 / h2, abs(e32 / e21))
    if order is None:
        return Convergence(kind="none")
    if kind == "oscillating":
        return Convergence(kind=kind, order=order)
    growth = (h2 / h1) ** order
    return Convergence(
        kind=kind,
        order=order,
        extrapolated=(growth * f1 - f2) / (growth - 1.0),
        uncertainty_frac=SAFETY * abs(e21 / f1) / (growth - 1.0) if f1 else None,
    )


# The right side grows with p, from ln r32 / ln r21 at p = 0: by bisection. Nothing when differences that do not shrink
# leave no order above zero.
def _order(r21: float, r32: float, ratio: float) -> float | None:
    if ratio <= math.log(r32) / math.log(r21) * (1 + 1e-9):
        return None
    low, high = 0.0, MAX_ORDER
    while high - low > 1e-12:
        middle = (low + high) / 2
        is_below = r21**middle * (r32**middle - 1.0) < ratio * (r21**middle - 1.0)
        low, high = (middle, high) if is_below else (low, middle)
    return low


@dataclass(frozen=True, kw_only=True)
class MeshRun:
    """One mesh: its cells, how long it took to solve, and the speeds at the probes and in the mean of the air [m/s]."""

    wanted_cell_m: float
    cell_m: float
    n_air_cells: int
    duration_s: float
    probe_speeds_m_s: tuple[float, ...]
    mean_speed_m_s: float


@dataclass(frozen=True, kw_only=True)
class MeshStudy:
    """All meshes, coarsest first, with the convergence at each probe and of the mean speed."""

    probes_m: tuple[Vec3, ...]
    runs: tuple[MeshRun, ...]
    probe_convergence: tuple[Convergence, ...]
    mean_convergence: Convergence

    def as_fields(self) -> dict[str, Any]:
        """Return the study as plain values."""
        return asdict(self)


def study_meshes(
    recipe: Recipe, cells_m: Sequence[float], *, probes_m: Sequence[Vec3] = (), progress: Progress | None = None
) -> MeshStudy:
    """Solve a room's wind on several meshes.

    A mesh divides the room into whole cells, so the nearest cells that do are taken for those that are wanted, and
    different ones for each.

    Args:
        recipe: A layout and its wind.
        cells_m: Edges of cells [m], at least three.
        probes_m: Where to look, world frame [m]; by default five places across the room that are air on all meshes.
        progress: Receives what is being done and how much of it is over, from 0 to 1.
    """
    layout, progress = recipe.environment.layout, progress or no_progress
    if layout is None:
        raise UsageError(
            "--mesh-study: expected a layout, whose cells can be chosen, was a room with cells of its own."
        )
    if len(set(cells_m)) < 3:
        raise UsageError(f"--mesh-study: expected at least three different cells, was {len(set(cells_m))}.")
    pairs = find_dividing_cell_sizes(layout.size_m, sorted(cells_m, reverse=True))
    probes = tuple(probes_m) or _default_probes(layout, recipe, [cell for _, cell in pairs])
    work = [cell_m**-4 for _, cell_m in pairs]
    runs: list[MeshRun] = []
    for i, (wanted_m, cell_m) in enumerate(pairs):
        done, share = sum(work[:i]) / sum(work), work[i] / sum(work)

        def report_fraction(
            text: str, fraction: float, done: float = done, share: float = share, cell_m: float = cell_m
        ) -> None:
            progress(f"{cell_m:.4g} m: {text}", done + share * fraction)

        runs.append(_run(recipe, layout, wanted_m, cell_m, probes, report_fraction))
    taken = [run.cell_m for run in runs]
    by_probe = np.array([run.probe_speeds_m_s for run in runs]).reshape(len(runs), -1)
    return MeshStudy(
        probes_m=probes,
        runs=tuple(runs),
        probe_convergence=tuple(compute_convergence(taken, speeds.tolist()) for speeds in by_probe.T),
        mean_convergence=compute_convergence(taken, [run.mean_speed_m_s for run in runs]),
    )


def find_dividing_cell_sizes(size_m: Vec3, wanted_m: Sequence[float]) -> list[tuple[float, float]]:
    """Return for each wanted edge of cells [m], coarsest first, the nearest that divides the room, each once."""
    common_mm = int(np.gcd.reduce([round(length_m * _MM) for length_m in size_m]))
    if any(abs(length_m * _MM - round(length_m * _MM)) > 1e-6 for length_m in size_m):
        raise UsageError(f"--mesh-study: expected a room of whole millimetres, was {point_text(size_m)} m.")
    pairs: list[tuple[float, float]] = []
    n = 0
    for cell_m in wanted_m:
        best = round(common_mm / _MM / cell_m)
        options = [k for k in range(max(1, best - 1), best + 2) if k > n] or [n + 1]
        n = min(options, key=lambda k: abs(np.log(common_mm / _MM / k / cell_m)))
        pairs.append((cell_m, common_mm / _MM / n))
    return pairs


def _run(
    recipe: Recipe, layout: Layout, wanted_m: float, cell_m: float, probes_m: Sequence[Vec3], report_fraction: Progress
) -> MeshRun:
    started_s = time.perf_counter()
    wind = recipe.wind.model_copy(update={"cell_m": cell_m})
    room = build_layout(layout, wind)
    raise_if_any(find_point_problems([(f"--probe {point_text(probe_m)}", probe_m) for probe_m in probes_m], room))
    made = solve_wind_of_scenario(
        room,
        recipe.environment.model_copy(update={"layout": layout}),
        wind,
        scenario_dir=recipe.directory,
        progress=report_fraction,
    )
    environment = with_wind(room, made.frames)
    is_air = environment.occupancy != Cell.SOLID
    return MeshRun(
        wanted_cell_m=wanted_m,
        cell_m=cell_m,
        n_air_cells=int(is_air.sum()),
        duration_s=time.perf_counter() - started_s,
        probe_speeds_m_s=tuple(_speeds_m_s(environment, np.asarray(probes_m)).tolist()),
        mean_speed_m_s=float(np.linalg.norm(environment.wind.velocity_m_s[-1][is_air], axis=1).mean(dtype=np.float64)),
    )


def _speeds_m_s(environment: Environment, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    grid, wind_m_s = environment.grid, environment.wind.velocity_m_s[-1]
    return np.linalg.norm(trilinear_wind_at_points(wind_m_s, np.asarray(grid.origin_m), grid.cell_m, points_m), axis=1)


# Moved up, then aside, out of what stands there on any of the meshes.
def _default_probes(layout: Layout, recipe: Recipe, cells_m: Sequence[float]) -> tuple[Vec3, ...]:
    rooms = [build_layout(layout, recipe.wind.model_copy(update={"cell_m": cell_m})) for cell_m in cells_m[:3]]
    probes: list[Vec3] = []
    for share in DEFAULT_PROBES_FRAC:
        for shift in (0.0, 0.05, -0.05, 0.1, -0.1, 0.15):
            x_m, y_m, z_m = (
                round(length_m * min(max(part + shift, 0.03), 0.97), 3)
                for part, length_m in zip(share, layout.size_m, strict=True)
            )
            if not any(find_point_problems([("", (x_m, y_m, z_m))], room) for room in rooms):
                probes.append((x_m, y_m, z_m))
                break
    return tuple(probes)


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
    (folder / STUDY_JSON_FILE).write_text(json.dumps(study.as_fields(), indent=2), encoding="utf-8")
    with (folder / STUDY_CSV_FILE).open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows(build_rows(study))
    written = [folder / STUDY_JSON_FILE, folder / STUDY_CSV_FILE]
    return [*written, folder / STUDY_PLOT_FILE] if _plot(study, folder / STUDY_PLOT_FILE) else written


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


def compare_solvers_in(recipe: Recipe, folder: Path, *, progress: Progress | None = None) -> SolverComparison:
    """Solve a room's wind by both solvers and save both environments, and the figures, to a folder.

    The folder then holds `built_in` and `openfoam`, environments with pictures from above, and
    `solver_comparison.json`.

    Args:
        recipe: The room and its wind; without an end of its own the fields after 5 s are compared.
        folder: Where.
        progress: Receives what is being done and how much of it is over, from 0 to 1.
    """
    wind, progress = recipe.wind, progress or no_progress
    if not isinstance(wind, WindSpec):
        raise UsageError(f"--compare-solvers: expected one of gslcosim's own solvers, was {wind.kind_name}.")
    if wind.save_every_s is not None:
        raise UsageError("--compare-solvers: expected one wind to compare, was wind.save_every_s. Leave it out.")
    room = build_geometry(recipe.environment, wind, scenario_dir=recipe.directory)
    compared = compare_solvers(
        room.occupancy != Cell.SOLID,
        room.grid.cell_m,
        build_patches(room, wind),
        end_time_s=wind.end_time_s or DEFAULT_END_S,
        average_from_s=wind.average_from_s,
        turbulence=wind.turbulence,
        progress=lambda done: progress("Solving the wind twice", done),
    )
    for solver, velocity_m_s in (("built_in", compared.built_in_m_s), ("openfoam", compared.openfoam_m_s)):
        made_from = plain_recipe(recipe.environment, wind.model_copy(update={"solver": solver}))
        environment = with_wind(room, WindFrames(velocity_m_s=velocity_m_s[np.newaxis]))
        save_with_views(
            environment, folder / solver, made_from=made_from, notices=room.notices, sources_m=recipe.sources_m
        )
    (folder / COMPARISON_FILE).write_text(json.dumps(comparison_to_json(compared), indent=2), encoding="utf-8")
    return compared


def comparison_to_json(compared: SolverComparison) -> dict[str, Any]:
    """Return the figures of a comparison as plain values."""
    return {
        "built_in_wall_s": compared.built_in_wall_s,
        "openfoam_wall_s": compared.openfoam_wall_s,
        "openfoam_ranks": compared.n_ranks,
        "agreement": asdict(compared.agreement),
    }
