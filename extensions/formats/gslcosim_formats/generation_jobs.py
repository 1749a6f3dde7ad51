"""Jobs that make environments, one or many at a time, and their results."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from gslcosim.base.errors import GslCosimError, MachineError, build_machine_error, build_path_error
from gslcosim.base.quantities import Vec3
from gslcosim.base.rng import stream
from gslcosim.environment.generation.builder import generate_environment
from gslcosim.environment.generation.wind import Progress, no_progress
from gslcosim.environment.model import Cell
from gslcosim.environment.positions import random_free_point_m
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
from gslcosim_formats.environment_views import draw_views
from gslcosim_formats.recipes import Recipe
from gslcosim_formats.worker_process import run_tasks


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
            recipe.environment.model_copy(update={"layout": layout.model_copy(update={"seed": seed})}),
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
            draw_views=partial(draw_views, sources_m=order.sources_m),
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
