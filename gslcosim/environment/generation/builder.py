"""Builder of environments: geometry, wind, scene and picture into a folder, one or many at a time."""

import io
import json
import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim import flow
from gslcosim.base.errors import FlowError, GslCosimError, MachineError, build_machine_error, build_path_error
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.base.worker_process import run_tasks
from gslcosim.environment.generation.cache import recipe
from gslcosim.environment.generation.wind import Progress, no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Cell, Environment, with_wind
from gslcosim.environment.picture import top_view_png
from gslcosim.environment.positions import random_free_point_m
from gslcosim.environment.scene_file import build_mjcf
from gslcosim.environment.store import HISTORY_FILE, PICTURE_FILE, REPORT_FILE, SCENE_FILE, save_environment
from gslcosim.environment.variants import fill_still_air
from gslcosim.scenario.loader import Recipe
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class BuildResult:
    """An environment that was made, and sentences for the user on how."""

    environment: Environment
    notices: tuple[str, ...]


def generate_environment(
    spec: EnvironmentSpec,
    wind: SolverSpec,
    folder: Path,
    *,
    scenario_dir: Path | None = None,
    sources_m: Sequence[Vec3] = (),
    progress: Progress | None = None,
) -> BuildResult:
    """Make an environment and save it to a folder, with its scene and a picture from above; nothing is cached.

    Args:
        spec: Where the room comes from; anything but a `path`, which is an environment already.
        wind: The air's motion and the cell of the grid.
        folder: Where; an environment that stands there is replaced.
        scenario_dir: What relative paths are relative to.
        sources_m: Sources of gas to show in the picture, world frame [m].
        progress: Receives what is being done and how much of it is over, from 0 to 1.
    """
    progress = progress or no_progress
    progress("Building the room", 0.0)
    room = build_geometry(spec, wind, scenario_dir=scenario_dir)
    blown = fill_still_air(room) if any(not door.is_open for door in spec.doors) else room
    made = solve_wind_of_scenario(blown, spec, wind, scenario_dir=scenario_dir, progress=progress)
    notices = (*room.notices, *made.notices)
    for notice in notices:
        _log.info(notice)
    environment = with_wind(room, made.frames)
    save_with_scene_and_picture(
        environment,
        folder,
        made_from=recipe(spec, wind),
        notices=notices,
        sources_m=sources_m,
        extras=_report_files(made.report),
    )
    progress("Saving the environment", 1.0)
    return BuildResult(environment=environment, notices=notices)


def save_with_scene_and_picture(
    environment: Environment,
    folder: Path,
    *,
    made_from: Mapping[str, Any],
    notices: Sequence[str],
    sources_m: Sequence[Vec3] = (),
    extras: Mapping[str, bytes] | None = None,
) -> None:
    """Save an environment with its scene for other programs and its picture for people; see `save_environment`.

    Args:
        environment: What to save.
        folder: Where; an environment that stands there is replaced.
        made_from: How it was made.
        notices: Notices about it.
        sources_m: Sources of gas to show in the picture, world frame [m].
        extras: Further files by name.
    """
    views = {
        SCENE_FILE: build_mjcf(environment).encode(),
        PICTURE_FILE: top_view_png(environment, sources_m=sources_m),
    }
    save_environment(environment, folder, made_from=made_from, notices=notices, extras={**views, **(extras or {})})


# How the wind was solved: figures, and a picture where the extra for plots is installed.
def _report_files(report: flow.WindReport | None) -> dict[str, bytes]:
    if report is None:
        return {}
    files = {REPORT_FILE: json.dumps(report.summary(), indent=2).encode()}
    picture = io.BytesIO()
    try:
        flow.plot_history(report, picture)
    except FlowError:
        return files
    return {**files, HISTORY_FILE: picture.getvalue()}


@dataclass(frozen=True, kw_only=True)
class GenerationJob:
    """An environment to make: from what, and where to put it."""

    spec: EnvironmentSpec
    wind: SolverSpec
    folder: Path
    scenario_dir: Path | None = None
    sources_m: tuple[Vec3, ...] = ()

    @property
    def kind(self) -> str:
        """Kind of environment: a kind of layout, or the key of what is read."""
        layout = self.spec.layout
        return next(iter(self.spec.model_fields_set), "") if layout is None else layout.kind

    @property
    def seed(self) -> int:
        """The layout's seed; 0 where nothing is random."""
        return 0 if self.spec.layout is None else self.spec.layout.seed


@dataclass(frozen=True, kw_only=True)
class GenerationResult:
    """Result of an order: figures of the environment, or the reason why there is none.

    `random_source_m` is a place in its free air, drawn with the layout's seed, for those who want a source anywhere.
    """

    order: GenerationJob
    duration_s: float
    n_air_cells: int | None = None
    n_solid_cells: int | None = None
    content_hash: str | None = None
    random_source_m: Vec3 | None = None
    notices: tuple[str, ...] = ()
    error: str | None = None
    is_refused_by_machine: bool = False


def build_jobs(recipe: Recipe, folder: Path, *, n: int = 1, first_seed: int | None = None) -> tuple[GenerationJob, ...]:
    """Return orders of n environments, each with the next seed, the folder itself or `kind_seed` in it for several."""
    layout = recipe.environment.layout
    if layout is None:
        return (_order(recipe, recipe.environment, folder),)
    first = layout.seed if first_seed is None else first_seed
    return tuple(
        _order(
            recipe,
            EnvironmentSpec(layout=layout.model_copy(update={"seed": seed})),
            folder if n == 1 else folder / f"{layout.kind}_{seed}",
        )
        for seed in range(first, first + n)
    )


def _order(recipe: Recipe, spec: EnvironmentSpec, folder: Path) -> GenerationJob:
    return GenerationJob(
        spec=spec, wind=recipe.wind, folder=folder, scenario_dir=recipe.directory, sources_m=recipe.sources_m
    )


def generate_many(
    orders: Sequence[GenerationJob], *, jobs: int = 1, report: Progress | None = None
) -> tuple[GenerationResult, ...]:
    """Make environments, several at a time if wanted; one that fails does not keep the others from being made.

    Args:
        orders: What to make.
        jobs: How many processes make them; with 1 it is this one.
        report: Receives what is being done and how much of it all is over, from 0 to 1.

    Returns:
        An outcome for each order, in their order.
    """
    report = report or no_progress
    outcomes = dict(_made_one_by_one(orders, report) if jobs == 1 else _made_by_processes(orders, jobs, report))
    return tuple(outcomes[i] for i in range(len(orders)))


def _made_one_by_one(orders: Sequence[GenerationJob], report: Progress) -> Iterator[tuple[int, GenerationResult]]:
    for i, order in enumerate(orders):

        def report_fraction(text: str, fraction: float, i: int = i) -> None:
            report(f"{i + 1} of {len(orders)}: {text}", (i + fraction) / len(orders))

        yield i, _made(order, report_fraction)


def _made_by_processes(
    orders: Sequence[GenerationJob], jobs: int, report: Progress
) -> Iterator[tuple[int, GenerationResult]]:
    report(f"0 of {len(orders)} made", 0.0)
    for n, result in enumerate(run_tasks(_made, orders, jobs), start=1):
        if result.failure is not None:
            text = f"{result.failure} Was there too little memory?"
            yield result.index, GenerationResult(order=orders[result.index], duration_s=0.0, error=text)
        else:
            yield result.index, result.value
        report(f"{n} of {len(orders)} made", n / len(orders))


def _made(order: GenerationJob, progress: Progress | None = None) -> GenerationResult:
    started_s = time.perf_counter()
    try:
        made = generate_environment(
            order.spec,
            order.wind,
            order.folder,
            scenario_dir=order.scenario_dir,
            sources_m=order.sources_m,
            progress=progress,
        )
        rng = stream(order.seed, "layout.random_source")
        random_source_m = random_free_point_m(made.environment, rng)
    except (GslCosimError, OSError, MemoryError) as error:
        problem = error
        if isinstance(error, OSError):
            problem = build_path_error(error, str(order.folder), "a folder that can be written", path=order.folder)
        elif isinstance(error, MemoryError):
            problem = build_machine_error(error, str(order.folder), "memory to make it")
        return GenerationResult(
            order=order,
            duration_s=time.perf_counter() - started_s,
            error=str(problem),
            is_refused_by_machine=isinstance(problem, MachineError),
        )
    environment = made.environment
    n_solid = int((environment.occupancy == Cell.SOLID).sum())
    return GenerationResult(
        order=order,
        duration_s=time.perf_counter() - started_s,
        n_air_cells=environment.occupancy.size - n_solid,
        n_solid_cells=n_solid,
        content_hash=environment.content_hash,
        random_source_m=random_source_m,
        notices=made.notices,
    )
