"""Cache of environments: generated from a scenario once, and found again by a hash of all their inputs."""

import hashlib
import json
import logging
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gslcosim.base.checksums import CHECKSUMS_FILE
from gslcosim.base.code_identity import hash_code, list_package_files
from gslcosim.base.disk_cache import keep_within_limit, mark_used
from gslcosim.base.errors import EnvironmentDataError, build_machine_error
from gslcosim.base.files import list_files
from gslcosim.base.kernel_cache import get_cache_root, get_code_roots
from gslcosim.environment.model import Environment, EnvironmentVariant
from gslcosim.environment.readers import list_reader_packages
from gslcosim.environment.store import FORMAT, load_environment
from gslcosim.environment.variants import find_variants, scenario_in_variant
from gslcosim.scenario.models.scenario import EnvironmentSpec, Scenario, SolverSpec
from gslcosim.scenario.models.wind import SOLVING, WindSpec

if TYPE_CHECKING:
    from gslcosim.environment.generation.wind import Progress

# Changes of a scenario in a small room, whose winds need all kernels of the solver.
SHORT_SOLVES = tuple(
    ("wind.solver=built_in", "wind.end_time_s=0.3", f"wind.{choice}")
    for choice in ("keep_turbulence=true", "turbulence=rng_k_epsilon", "turbulence=smagorinsky")
)
# Keys that have no effect on a wind that is not solved.
_OF_SOLVING = {key for key, solvers in WindSpec.belongs.items() if set(solvers) <= set(SOLVING)}
_BLOCK = 1 << 20
_log = logging.getLogger(__name__)


def recipe_hash(environment: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None = None) -> str:
    """Return 32 hexadecimal digits of everything that determines the content of a generated environment.

    That is layout, wind, the code that builds rooms and solves the wind, the packages that compile it, and the content
    of all input files.

    Args:
        environment: The scenario's environment block; any but a `path`.
        wind: Its wind block.
        scenario_dir: Base folder of relative paths.
    """
    digest = hashlib.blake2b(json.dumps(recipe(environment, wind), sort_keys=True).encode(), digest_size=16)
    readers = list_reader_packages(environment, wind)
    digest.update(hash_code(sources(wind, readers)).encode())
    packages = [name for name in readers if name not in get_code_roots()]
    if not isinstance(wind, WindSpec):
        packages.append(type(wind).__module__.partition(".")[0])
    for package in packages:
        digest.update(_package_hash(package).encode())
    for path in _files_read(environment, wind, scenario_dir):
        _update_with(digest, path)
    return digest.hexdigest()


def recipe(environment: EnvironmentSpec, wind: SolverSpec) -> dict[str, Any]:
    """Return the recipe of an environment as plain values."""
    is_own = isinstance(wind, WindSpec)
    wind_values = wind.model_dump(mode="json", exclude=_OF_SOLVING if is_own and not wind.solves else None)
    if wind.solver == "auto" and environment.folder_key is None:
        wind_values["solver"] = "built_in"
    # Without them, the recipe is the one from before these keys existed.
    for key in ("keep_turbulence", "buoyancy"):
        if not wind_values.get(key):
            wind_values.pop(key, None)
    packages = {name: version(name) for name in ("numpy", "numba")} if wind.solves or not is_own else {}
    made_from = environment.model_dump(mode="json", exclude_none=True, exclude={"doors"})
    # An open door leaves no trace in the room.
    doors = [door.model_dump(mode="json", exclude={"is_open"}) for door in environment.doors if not door.is_open]
    made_from |= {"doors": doors} if doors else {}
    return {"format": FORMAT, **made_from, "wind": wind_values, "packages": packages}


def sources(wind: SolverSpec, readers: Iterable[str]) -> list[Path]:
    """Return the code that determines an environment's content: when it changes, environments are generated anew.

    Args:
        wind: The scenario's wind block.
        readers: Packages from `list_reader_packages`.
    """
    parts = ["gslcosim/environment/*", "gslcosim/environment/layouts"]
    if not isinstance(wind, WindSpec):
        parts += ["gslcosim/flow", "gslcosim/environment/generation/wind.py"]  # a package may build on them
    elif wind.solves:
        parts.append("gslcosim/flow")
    parts += [name for name in readers if name in get_code_roots()]
    # Checks of positions have no effect on the environment itself.
    return [path for path in list_package_files(*parts) if path.name != "positions.py"]


# All code of the package, because the part that matters is unknown, and its version for compiled parts.
def _package_hash(name: str) -> str:
    digest = hashlib.blake2b(digest_size=16)
    for distribution in sorted(packages_distributions().get(name, ())):
        digest.update(f"{distribution} {version(distribution)}\n".encode())
    module = import_module(name)
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    paths = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    if not folders and module.__file__ is not None:
        paths = [Path(module.__file__)]
    for path in paths:
        _update_with(digest, path)
    return digest.hexdigest()


def _files_read(environment: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> Iterator[Path]:
    for text in (*environment.inputs, *([] if wind.file is None else [wind.file])):
        place = (scenario_dir or Path()) / Path(text).expanduser()
        if place.is_file():
            yield place
        else:
            # Gas frames have no effect on the wind, and make up most of an imported folder.
            yield from (path for path in list_files(place) if not path.name.startswith("iteration_"))


def _update_with(digest: Any, path: Path) -> None:
    digest.update(path.name.encode())
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)


def prepare_environment(
    scenario: Scenario,
    *,
    scenario_dir: Path | None = None,
    cache_dir: Path | None = None,
    progress: "Progress | None" = None,
) -> Path:
    """Return the folder of a scenario's environment; generate it where it is not in the cache.

    An environment from a layout, or from the folder of another program, lies in the cache under its `recipe_hash`.
    Processes may call this at the same time: each generates the environment, the first to finish keeps its folder, and
    all return it. A damaged folder is generated anew.

    Args:
        scenario: Its `environment` and `wind`; with `environment.path` its `wind` has no effect.
        scenario_dir: Base folder of relative paths; the working directory if absent.
        cache_dir: Folder of the cache; `environments` in `gslcosim`'s cache if absent.
        progress: Receives the current step and its fraction done, from 0 to 1; only when there is work.
    """
    spec, wind = scenario.environment, scenario.wind
    if spec.path is not None:
        from gslcosim.environment.geometry_source import find_folder

        folder = find_folder(spec, scenario_dir)
        try:
            load_environment(folder)
        except EnvironmentDataError as error:
            raise EnvironmentDataError(f"environment.path: {error}") from error
        return folder
    folder = _folder_in_cache(scenario, scenario_dir, cache_dir)
    mark_used(folder)
    if not _is_usable(folder):
        from gslcosim.environment.generation.builder import generate_environment

        try:
            generate_environment(spec, wind, folder, scenario_dir=scenario_dir, progress=progress)
        except OSError as error:
            # The error of a full disk has no file name.
            if error.filename is not None and not Path(error.filename).is_relative_to(folder.parent.parent):
                raise
            remedy = "Free room there, or set GSLCOSIM_CACHE to a folder that can be written."
            raise build_machine_error(
                error, "cache", "a folder that can be written", path=folder.parent, remedy=remedy
            ) from error
        keep_within_limit()
    return folder


def find_environment(scenario: Scenario, *, scenario_dir: Path | None = None) -> Environment | None:
    """Return a scenario's environment from the cache; None where `prepare_environment` has not generated it yet.

    A cached environment had no problems, so that a check need not build its room again. Environments from a layout
    only: the files of other programs are not read.
    """
    if scenario.environment.layout is None or scenario.wind.file is not None:
        return None
    with suppress(EnvironmentDataError):
        folder = _folder_in_cache(scenario, scenario_dir, None)
        mark_used(folder)
        return load_environment(folder) if folder.exists() else None
    return None


def _folder_in_cache(scenario: Scenario, scenario_dir: Path | None, cache_dir: Path | None) -> Path:
    name = recipe_hash(scenario.environment, scenario.wind, scenario_dir=scenario_dir)
    return (cache_dir or get_cache_root() / "environments") / name


def _is_usable(folder: Path) -> bool:
    if not (folder / CHECKSUMS_FILE).exists():
        return False
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        text = str(error).replace("\n", " ")
        _log.warning("An environment in the cache is damaged and is made anew: %s", text)
        return False
    return True


def prepare_variants(
    scenario: Scenario, *, scenario_dir: Path | None = None, progress: "Progress | None" = None
) -> dict[EnvironmentVariant, Path]:
    """Return the environment of each variant that events may bring about, except the first; generated where needed.

    Args:
        scenario: Its `events`, `environment` and `wind`.
        scenario_dir: Base folder of relative paths; the working directory if absent.
        progress: Receives the current step; only when there is work.
    """
    folders: dict[EnvironmentVariant, Path] = {}
    for variant in find_variants(scenario)[1:] if scenario.events else ():
        changed = scenario_in_variant(scenario, variant)
        folders[variant] = prepare_environment(changed, scenario_dir=scenario_dir, progress=progress).resolve()
    return folders


def load_rooms(
    folder: Path, scenario: Scenario, *, scenario_dir: Path | None = None, progress: "Progress | None" = None
) -> tuple[Environment, dict[EnvironmentVariant, Path]]:
    """Return the environment in a folder with its variants, and the folders of these.

    Args:
        folder: The room at the start.
        scenario: Its `events`, `environment` and `wind`.
        scenario_dir: Base folder of relative paths; the working directory if absent.
        progress: Receives the current step; only when there is work.
    """
    later_rooms = prepare_variants(scenario, scenario_dir=scenario_dir, progress=progress)
    return with_variants(load_environment(folder), later_rooms), later_rooms


def with_variants(environment: Environment, folders: Mapping[EnvironmentVariant, Path]) -> Environment:
    """Return an environment with its variants in `later_rooms`.

    Args:
        environment: The room at the start.
        folders: Environment folders by variant.
    """
    rooms: dict[EnvironmentVariant, Environment] = {}
    for variant, folder in folders.items():
        room = load_environment(folder)
        has_moved_door = room.boxes != environment.boxes
        if room.grid != environment.grid or not (
            has_moved_door or np.array_equal(room.occupancy, environment.occupancy)
        ):
            raise EnvironmentDataError(
                f"events: expected a room on the grid of {environment.name}, {environment.grid}, was another, "
                f"{room.grid}. Remove the folder so that it is made anew.\nFolder: {folder}"
            )
        rooms[variant] = room
    return replace(environment, later_rooms=rooms) if rooms else environment
