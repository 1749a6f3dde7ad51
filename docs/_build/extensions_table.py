"""Table of what the project's own extensions offer: `make contract` writes gslcosim/base/extensions.json.

The core reads it to answer for an extension that is not installed. All of it comes from the registrations of the
extensions, which have to be installed to make it.
"""

import json
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from gslcosim.base.extensions import CHECKS_GROUP, GEOMETRY_GROUP, STARTS_GROUP, Registration, list_registered
from gslcosim.scenario.checks.registry import SCENARIO
from gslcosim.scenario.models.gas import GAS_ENTRY_POINTS

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "gslcosim" / "base" / "extensions.json"


def list_extensions() -> list[str]:
    """Return the names of the extensions in this checkout."""
    return sorted(path.parent.name for path in ROOT.glob("extensions/*/pyproject.toml"))


def list_keys(extension: str) -> list[str]:
    """Return the keys of scenarios that an extension adds or reads, such as `agents[].start.ros2`; models with names."""
    keys = (key for point in _points_of(extension, STARTS_GROUP) for key in point.load())
    added = [f"{key.place}.{key.name}".lstrip(".") for key in keys]
    read = [point.name for point in _points_of(extension, GEOMETRY_GROUP)]
    models = [f"gas.model={point.name}" for point in _points_of(extension, GAS_ENTRY_POINTS)]
    return sorted([*added, *read, *models])


def list_files(extension: str) -> list[str]:
    """Return the kinds of files that an extension adds, such as `suite`."""
    return [
        point.name for point in _points_of(extension, CHECKS_GROUP) if not point.name.startswith(f"{SCENARIO}.")
    ]


def list_names(extension: str) -> list[str]:
    """Return the public names of an extension, its own among them, such as `open_run`."""
    return [extension, *sorted(getattr(import_module(_name_module(extension)), "__all__", ()))]


def list_modules(extension: str) -> list[str]:
    """Return the packages that an extension installs."""
    return [_name_module(extension)]


KINDS: dict[str, Callable[[str], list[str]]] = {
    "keys": list_keys,
    "files": list_files,
    "names": list_names,
    "modules": list_modules,
}


def build_table() -> str:
    """Return the text of the table."""
    table = {
        extension: {kind: offered for kind, function in KINDS.items() if (offered := function(extension))}
        for extension in list_extensions()
    }
    return f"{json.dumps(table, indent=1)}\n"


def _points_of(extension: str, group: str) -> list[Registration]:
    return [point for point in list_registered(group) if point.distribution == f"gslcosim-{extension}"]


def _name_module(extension: str) -> str:
    return f"gslcosim_{extension}"


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        TABLE.write_text(build_table(), encoding="utf-8")
    else:
        sys.stdout.write(build_table())
