"""From a scenario to the folder of its environment: generated once, kept by what it was made from."""

import hashlib
import json
import logging
import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim import flow
from gslcosim._kernel_cache import PACKAGE_DIR, cache_root
from gslcosim.environment.grid import Vec3
from gslcosim.environment.mjcf import mjcf_of
from gslcosim.environment.model import Cell, Environment, WindFrames
from gslcosim.environment.picture import top_view_png
from gslcosim.environment.placement import random_free_point_m
from gslcosim.environment.room import Room, build_room, with_wind
from gslcosim.environment.store import (
    FORMAT,
    PICTURE_FILE,
    SCENE_FILE,
    environment_folder,
    load_environment,
    save_environment,
)
from gslcosim.errors import EnvironmentDataError, GslCosimError
from gslcosim.rng import stream
from gslcosim.scenario.models import Layout, Scenario, WindSpec
from gslcosim.scenario.recipes import Recipe

Progress = Callable[[str, float], None]

_log = logging.getLogger(__name__)

# The code that decides what a generated environment holds: when it changes, environments are made anew.
_ROOM_SOURCES = (
    "buildings", "furnishing", "grid", "layouts", "mjcf", "model", "occupancy", "occupancy_kernels", "openings",
    "outdoors", "picture", "pieces", "room", "warehouses",
)  # fmt: skip


def prepare_environment(
    scenario: Scenario,
    *,
    scenario_dir: Path | None = None,
    cache_dir: Path | None = None,
    progress: Progress | None = None,
) -> Path:
    """Return the folder of a scenario's environment, made now if it was not made before.

    An environment from a `layout` is kept in the cache under a hash of all it depends on: layout, wind, the code that
    makes rooms and solves the wind, and the packages that compile it. Processes may call this at the same time: each
    makes the environment, the first to finish keeps its folder, and all return it. A folder that was damaged since is
    made anew.

    Args:
        scenario: Its `environment` and `wind`; with `environment.path` its `wind` has no meaning.
        scenario_dir: What a relative `environment.path` is relative to; the working directory if absent.
        cache_dir: Where generated environments are kept; `environments` in `gslcosim`'s cache if absent.
        progress: Is told what is being done and how much of it is over, from 0 to 1; only when there is work.

    Raises:
        ScenarioError: the room is impossible.
        EnvironmentDataError: `environment.path` is not the folder of a whole environment.
        FlowError: the wind cannot be solved.
    """
    spec = scenario.environment
    if spec.path is not None:
        return _checked_folder(environment_folder(spec.path, scenario_dir))
    assert spec.layout is not None, "an EnvironmentSpec has either"
    folder = (cache_dir or cache_root() / "environments") / recipe_hash(spec.layout, scenario.wind)
    if not _is_usable(folder):
        generate_environment(spec.layout, scenario.wind, folder, progress=progress)
    return folder


@dataclass(frozen=True, kw_only=True)
class Order:
    """An environment to make: from what, and where to put it."""

    layout: Layout
    wind: WindSpec
    folder: Path
    sources_m: tuple[Vec3, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of an order: figures of the environment, or the reason why there is none.

    `random_source_m` is a place in its free air, drawn with the layout's seed, for those who want a source anywhere.
    """

    order: Order
    duration_s: float
    n_air_cells: int | None = None
    n_solid_cells: int | None = None
    content_hash: str | None = None
    random_source_m: Vec3 | None = None
    error: str | None = None


def orders_of(recipe: Recipe, folder: Path, *, n: int = 1, first_seed: int | None = None) -> tuple[Order, ...]:
    """Return orders of n environments, each with the next seed, the folder itself or `kind_seed` in it for several."""
    first = recipe.layout.seed if first_seed is None else first_seed
    return tuple(
        Order(
            layout=recipe.layout.model_copy(update={"seed": seed}),
            wind=recipe.wind,
            folder=folder if n == 1 else folder / f"{recipe.layout.kind}_{seed}",
            sources_m=recipe.sources_m,
        )
        for seed in range(first, first + n)
    )


def generate_many(orders: Sequence[Order], *, jobs: int = 1, report: Progress | None = None) -> tuple[Outcome, ...]:
    """Make environments, several at a time if wanted; one that fails does not keep the others from being made.

    Args:
        orders: What to make.
        jobs: How many processes make them; with 1 it is this one.
        report: Is told what is being done and how much of it all is over, from 0 to 1.

    Returns:
        An outcome for each order, in their order.
    """
    report = report or _ignore
    outcomes = dict(_made_one_by_one(orders, report) if jobs == 1 else _made_by_processes(orders, jobs, report))
    return tuple(outcomes[i] for i in range(len(orders)))


def _made_one_by_one(orders: Sequence[Order], report: Progress) -> Iterator[tuple[int, Outcome]]:
    for i, order in enumerate(orders):

        def tell(text: str, fraction: float, i: int = i) -> None:
            report(f"{i + 1} of {len(orders)}: {text}", (i + fraction) / len(orders))

        yield i, _made(order, tell)


def _made_by_processes(orders: Sequence[Order], jobs: int, report: Progress) -> Iterator[tuple[int, Outcome]]:
    # Spawned, because threads of this process must not be copied into the others.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=min(jobs, len(orders)), mp_context=context) as pool:
        futures = {pool.submit(_made, order): i for i, order in enumerate(orders)}
        report(f"0 of {len(orders)} made", 0.0)
        try:
            for n, future in enumerate(as_completed(futures), start=1):
                yield futures[future], _outcome_of(future, orders[futures[future]])
                report(f"{n} of {len(orders)} made", n / len(orders))
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _outcome_of(future: "Future[Outcome]", order: Order) -> Outcome:
    try:
        return future.result()
    except BrokenProcessPool:
        return Outcome(
            order=order, duration_s=0.0, error="the process that made it ended; was there too little memory?"
        )


def _made(order: Order, progress: Progress | None = None) -> Outcome:
    started_s = time.perf_counter()
    try:
        environment = generate_environment(
            order.layout, order.wind, order.folder, sources_m=order.sources_m, progress=progress
        )
        rng = stream(order.layout.seed, "layout.random_source")
        random_source_m = random_free_point_m(environment, rng)
    except (GslCosimError, OSError, MemoryError) as error:
        return Outcome(
            order=order, duration_s=time.perf_counter() - started_s, error=str(error) or type(error).__name__
        )
    n_solid = int((environment.occupancy == Cell.SOLID).sum())
    return Outcome(
        order=order,
        duration_s=time.perf_counter() - started_s,
        n_air_cells=environment.occupancy.size - n_solid,
        n_solid_cells=n_solid,
        content_hash=environment.content_hash,
        random_source_m=random_source_m,
    )


def recipe_hash(layout: Layout, wind: WindSpec) -> str:
    """Return 32 hexadecimal digits of all that decides what a generated environment will hold."""
    digest = hashlib.blake2b(json.dumps(_recipe(layout, wind), sort_keys=True).encode(), digest_size=16)
    for path in _sources(wind):
        digest.update(path.name.encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _recipe(layout: Layout, wind: WindSpec) -> dict[str, Any]:
    is_solved = wind.solver != "uniform"
    # Uniform wind does not depend on how long a solver would have run.
    wind_values = wind.model_dump(mode="json", exclude=None if is_solved else {"end_time_s", "average_from_s"})
    packages = {name: version(name) for name in ("numpy", "numba")} if is_solved else {}
    return {"format": FORMAT, "layout": layout.model_dump(mode="json"), "wind": wind_values, "packages": packages}


def _sources(wind: WindSpec) -> list[Path]:
    sources = [PACKAGE_DIR / "environment" / f"{name}.py" for name in _ROOM_SOURCES]
    if wind.solver != "uniform":
        sources += sorted((PACKAGE_DIR / "flow").rglob("*.py"))
    return sources


def generate_environment(
    layout: Layout,
    wind: WindSpec,
    folder: Path,
    *,
    sources_m: Sequence[Vec3] = (),
    progress: Progress | None = None,
) -> Environment:
    """Make an environment and save it to a folder, with its scene and a picture from above; nothing is cached.

    Args:
        layout: The room.
        wind: The air's motion and the cell of the grid.
        folder: Where; an environment that stands there is replaced.
        sources_m: Sources of gas to show in the picture, world frame [m].
        progress: Is told what is being done and how much of it is over, from 0 to 1.

    Raises:
        ScenarioError: the room is impossible.
        FlowError: the wind cannot be solved.
        EnvironmentDataError: the folder holds something else.
    """
    progress = progress or _ignore
    progress("Building the room", 0.0)
    room = build_room(layout, wind)
    for notice in room.notices:
        _log.info(notice)
    velocity_m_s = _uniform(room, wind) if wind.solver == "uniform" else _solved(room, wind, progress)
    environment = with_wind(room, WindFrames(velocity_m_s=velocity_m_s[np.newaxis]))
    extras = {
        SCENE_FILE: mjcf_of(environment).encode(),
        PICTURE_FILE: top_view_png(environment, sources_m=sources_m),
    }
    save_environment(environment, folder, made_from=_recipe(layout, wind), notices=room.notices, extras=extras)
    progress("Saving the environment", 1.0)
    return environment


def _uniform(room: Room, wind: WindSpec) -> NDArray[np.float32]:
    velocity_m_s = np.zeros((*room.grid.shape, 3), dtype=np.float32)
    velocity_m_s[room.occupancy != Cell.SOLID] = wind.inlet_velocity_m_s
    return velocity_m_s


def _solved(room: Room, wind: WindSpec, progress: Progress) -> NDArray[np.float32]:
    patches = [
        flow.Inlet(min_m=opening.min_m, max_m=opening.max_m, velocity_m_s=opening.velocity_m_s)
        if opening.kind == "inlet"
        else flow.Outlet(min_m=opening.min_m, max_m=opening.max_m)
        for opening in room.openings
    ]
    return flow.solve_wind(
        room.occupancy != Cell.SOLID,
        room.grid.cell_m,
        patches,
        end_time_s=wind.end_time_s,
        average_from_s=wind.average_from_s,
        progress=lambda fraction: progress("Solving the wind", fraction),
    )


def _checked_folder(folder: Path) -> Path:
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        raise EnvironmentDataError(f"environment.path: {error}") from error
    return folder


def _is_usable(folder: Path) -> bool:
    if not folder.exists():
        return False
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        _log.warning("An environment in the cache is damaged and is made anew: %s", error)
        return False
    return True


def _ignore(_text: str, _fraction: float) -> None:
    pass
