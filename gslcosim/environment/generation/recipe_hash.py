"""Recipe hash of a generated environment: the same hash, the same environment."""

import hashlib
import json
from collections.abc import Iterator
from importlib import import_module
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

from gslcosim.base.code_identity import hash_code, list_package_files
from gslcosim.environment.store import FORMAT
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec
from gslcosim.scenario.models.wind import SOLVING, WindSpec

# What a wind that is not solved does not depend on.
_OF_SOLVING = {key for key, solvers in WindSpec.belongs.items() if set(solvers) <= set(SOLVING)}
_BLOCK = 1 << 20


def recipe_hash(environment: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None = None) -> str:
    """Return 32 hexadecimal digits of all that decides what a generated environment will hold.

    That is layout, wind, the code that makes rooms and solves the wind, the packages that compile it, and the content
    of all files that are read.

    Args:
        environment: What the scenario says of its environment; any but a `path`.
        wind: And of its wind.
        scenario_dir: What relative paths are relative to.
    """
    digest = hashlib.blake2b(json.dumps(recipe(environment, wind), sort_keys=True).encode(), digest_size=16)
    digest.update(hash_code(sources(environment, wind)).encode())
    if not isinstance(wind, WindSpec):
        digest.update(_package_hash(type(wind)).encode())
    for path in _files_read(environment, wind, scenario_dir):
        digest.update(path.name.encode())
        _update_with(digest, path)
    return digest.hexdigest()


def recipe(environment: EnvironmentSpec, wind: SolverSpec) -> dict[str, Any]:
    """Return what an environment is made from as plain values."""
    is_own = isinstance(wind, WindSpec)
    wind_values = wind.model_dump(mode="json", exclude=_OF_SOLVING if is_own and not wind.solves else None)
    if wind.solver == "auto" and environment.folder_key is None:
        wind_values["solver"] = "built_in"
    packages = {name: version(name) for name in ("numpy", "numba")} if wind.solves or not is_own else {}
    made_from = environment.model_dump(mode="json", exclude_none=True, exclude={"doors"})
    # One that is open is not there.
    doors = [door.model_dump(mode="json", exclude={"is_open"}) for door in environment.doors if not door.is_open]
    made_from |= {"doors": doors} if doors else {}
    return {"format": FORMAT, **made_from, "wind": wind_values, "packages": packages}


def sources(environment: EnvironmentSpec, wind: SolverSpec) -> list[Path]:
    """Return the code that decides what an environment holds: when it changes, environments are made again."""
    parts = ["gslcosim/environment/*", "gslcosim/environment/layouts", "gslcosim/environment/build/geometry_source.py"]
    if environment.geometry is not None:
        parts.append("gslcosim/environment/geometry")
    if environment.folder_key is not None or wind.file is not None:
        parts.append("gslcosim/environment/formats")
    if not isinstance(wind, WindSpec):
        parts += ["gslcosim/flow", "gslcosim/environment/generation/wind.py"]  # a package may build on them
    elif wind.solves:
        parts += ["gslcosim/flow"] if wind.solver == "openfoam" else ["gslcosim/flow/*", "gslcosim/flow/boundaries"]
    return list_package_files(*parts)


# All code of the package, since nobody knows what of it the wind depends on, and its version for what is compiled.
def _package_hash(block: type[SolverSpec]) -> str:
    name = block.__module__.partition(".")[0]
    digest = hashlib.blake2b(digest_size=16)
    for distribution in sorted(packages_distributions().get(name, ())):
        digest.update(f"{distribution} {version(distribution)}\n".encode())
    module = import_module(name)
    folders = [Path(folder) for folder in getattr(module, "__path__", ())]
    paths = [path for folder in folders for path in sorted(folder.rglob("*.py"))]
    if not folders and module.__file__ is not None:
        paths = [Path(module.__file__)]
    for path in paths:
        digest.update(path.name.encode())
        _update_with(digest, path)
    return digest.hexdigest()


def _files_read(environment: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> Iterator[Path]:
    if environment.folder_key is not None:
        from gslcosim.environment.build.geometry_source import find_folder

        yield from _files_in(find_folder(environment, scenario_dir))
    for file in environment.geometry.files if environment.geometry is not None else ():
        yield (scenario_dir or Path()) / Path(file).expanduser()
    if wind.file is not None:
        from gslcosim.environment.build.geometry_source import wind_file

        yield from _files_in(wind_file(wind, scenario_dir))


# Gas frames do not decide the wind, and are by far the most of an imported folder.
def _files_in(place: Path) -> Iterator[Path]:
    if place.is_file():
        yield place
        return
    for path in sorted(place.rglob("*")):
        if path.is_file() and not path.name.startswith("iteration_"):
            yield path


def _update_with(digest: Any, path: Path) -> None:
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
