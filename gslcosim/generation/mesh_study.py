"""One room solved on several meshes: winds at some points, and how they converge."""

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.grid import point_text
from gslcosim.environment.layouts.building import build_room
from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.of_scenario.places import problems_of_points
from gslcosim.environment.problems import raise_if_any
from gslcosim.environment.room import with_wind
from gslcosim.environment.wind_kernels import trilinear_wind_at_points
from gslcosim.errors import UsageError
from gslcosim.generation.convergence import Convergence, convergence_of
from gslcosim.generation.winds import Progress, no_progress, wind_of
from gslcosim.quantities import Vec3
from gslcosim.scenario.models.layouts import Layout
from gslcosim.scenario.models.scenario import EnvironmentSpec
from gslcosim.scenario.recipes import Recipe

# Where the room is looked at unless told otherwise, as shares of its size: before, between and behind, and high up.
DEFAULT_PROBES_FRAC = ((0.2, 0.1, 0.25), (0.2, 0.8, 0.25), (0.8, 0.2, 0.25), (0.8, 0.9, 0.25), (0.5, 0.5, 0.75))
# Of the meshes wanted, how far one may be off for its cells to divide the room.
_MM = 1000


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
        progress: Is told what is being done and how much of it is over, from 0 to 1.

    Raises:
        UsageError: there is no layout, or there are too few meshes.
        ScenarioError: a probe lies in a solid.
        FlowError: a wind cannot be solved.
    """
    layout, progress = recipe.environment.layout, progress or no_progress
    if layout is None:
        raise UsageError(
            "--mesh-study: expected a layout, whose cells can be chosen, was a room with cells of its own."
        )
    if len(set(cells_m)) < 3:
        raise UsageError(f"--mesh-study: expected at least three different cells, was {len(set(cells_m))}.")
    pairs = dividing_cells(layout.size_m, sorted(cells_m, reverse=True))
    probes = tuple(probes_m) or _default_probes(layout, recipe, [cell for _, cell in pairs])
    work = [cell_m**-4 for _, cell_m in pairs]
    runs: list[MeshRun] = []
    for i, (wanted_m, cell_m) in enumerate(pairs):
        done, share = sum(work[:i]) / sum(work), work[i] / sum(work)

        def tell(text: str, fraction: float, done: float = done, share: float = share, cell_m: float = cell_m) -> None:
            progress(f"{cell_m:.4g} m: {text}", done + share * fraction)

        runs.append(_run(recipe, layout, wanted_m, cell_m, probes, tell))
    taken = [run.cell_m for run in runs]
    by_probe = np.array([run.probe_speeds_m_s for run in runs]).reshape(len(runs), -1)
    return MeshStudy(
        probes_m=probes,
        runs=tuple(runs),
        probe_convergence=tuple(convergence_of(taken, speeds.tolist()) for speeds in by_probe.T),
        mean_convergence=convergence_of(taken, [run.mean_speed_m_s for run in runs]),
    )


def dividing_cells(size_m: Vec3, wanted_m: Sequence[float]) -> list[tuple[float, float]]:
    """Return for each wanted edge of cells [m], coarsest first, the nearest that divides the room, each once.

    Raises:
        UsageError: the room's sides have no common measure of whole millimetres.
    """
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
    recipe: Recipe, layout: Layout, wanted_m: float, cell_m: float, probes_m: Sequence[Vec3], tell: Progress
) -> MeshRun:
    started_s = time.perf_counter()
    wind = recipe.wind.model_copy(update={"cell_m": cell_m})
    room = build_room(layout, wind)
    raise_if_any(problems_of_points([(f"--probe {point_text(probe_m)}", probe_m) for probe_m in probes_m], room))
    made = wind_of(room, EnvironmentSpec(layout=layout), wind, scenario_dir=recipe.directory, progress=tell)
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
    rooms = [build_room(layout, recipe.wind.model_copy(update={"cell_m": cell_m})) for cell_m in cells_m[:3]]
    probes: list[Vec3] = []
    for share in DEFAULT_PROBES_FRAC:
        for shift in (0.0, 0.05, -0.05, 0.1, -0.1, 0.15):
            x_m, y_m, z_m = (
                round(length_m * min(max(part + shift, 0.03), 0.97), 3)
                for part, length_m in zip(share, layout.size_m, strict=True)
            )
            if not any(problems_of_points([("", (x_m, y_m, z_m))], room) for room in rooms):
                probes.append((x_m, y_m, z_m))
                break
    return tuple(probes)
