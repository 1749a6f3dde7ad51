"""Extensions: installed packages that add commands, checks and blocks by entry points, and remedies for absent ones.

The core finds extensions by the entry points of their distributions and contains the name of none. `extensions.json`
beside this module lists the offers of the project's own extensions; `make contract` writes it from their registrations.
It decides nothing, and only serves to name the extension that a request needs and its installation.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, TypeVar

from gslcosim.base.errors import UsageError

# Packages and modules whose code decides the results of runs.
RESULT_CODE_GROUP = "gslcosim.result_code"
COMMANDS_GROUP = "gslcosim.commands"
# Options that an extension adds to another package's command, after which each point is named, as `bench.run`.
OPTIONS_GROUP = "gslcosim.options"
CHECKS_GROUP = "gslcosim.checks"
STARTS_GROUP = "gslcosim.starts"
EXPORTERS_GROUP = "gslcosim.exporters"
GEOMETRY_GROUP = "gslcosim.geometry"
AGENTS_GROUP = "gslcosim.agents"
# Functions that find further facts on the validity of runs.
FINDINGS_GROUP = "gslcosim.findings"
# Readers of folders that are rows among runs in lists.
RUN_ROWS_GROUP = "gslcosim.run_rows"

Offered = TypeVar("Offered")
# Kinds of requests: a word of the command line, a dotted key of a file, a kind of file, a format, a Python name.
What = Literal["commands", "keys", "files", "formats", "names", "modules"]


@dataclass(frozen=True, kw_only=True)
class Registration:
    """One entry point of an installed distribution: its group, its name, and `module:attribute`."""

    group: str
    name: str
    value: str
    distribution: str

    def load(self) -> Any:
        """Import the module and return the attribute, or the module if no attribute is named."""
        module, _, attributes = self.value.partition(":")
        found: Any = import_module(module.strip())
        for attribute in filter(None, attributes.strip().split(".")):
            found = getattr(found, attribute)
        return found


def load_registered(
    group: str, expected: Callable[[object], Offered | None], what: str, *, name: str | None = None
) -> Iterator[Offered]:
    """Yield the objects that installed extensions register in a group of entry points, in the order of the points'
    names.

    Args:
        group: The group, such as `COMMANDS_GROUP`.
        expected: Returns the wanted object from a registered one, or None if it is something else.
        what: Noun for the wanted object, in errors.
        name: The name of the points; by default all.

    Raises:
        UsageError: a package cannot be imported, or registers something else.
    """
    for point in list_registered(group):
        if name is not None and point.name != name:
            continue
        try:
            offered: object = point.load()
        # Another project's package may raise anything on import.
        except Exception as error:
            raise UsageError(
                f"{group} {point.name}: expected {point.value} to be imported, was {error!r}. "
                f"Correct {point.distribution} and install it again, or uninstall it."
            ) from error
        accepted = expected(offered)
        if accepted is None:
            raise UsageError(
                f"{group} {point.name}: expected {what} in {point.value}, was {offered!s:.60}. "
                f"Correct {point.distribution} and install it again, or uninstall it."
            )
        yield accepted


def instance_of(kind: type[Offered]) -> Callable[[object], Offered | None]:
    """Return a function that accepts an instance of a class, for `load_registered`."""
    return lambda offered: offered if isinstance(offered, kind) else None


def tuple_of(kind: type[Offered]) -> Callable[[object], tuple[Offered, ...] | None]:
    """Return a function that accepts a tuple of instances of a class, for `load_registered`."""
    return lambda offered: (
        offered if isinstance(offered, tuple) and all(isinstance(each, kind) for each in offered) else None
    )


def list_registered(group: str) -> list[Registration]:
    """Return the entry points of a group, sorted by name, without imports."""
    return [point for point in list_registrations() if point.group == group]


def list_registrations() -> tuple[Registration, ...]:
    """Return all entry points of gslcosim's groups, sorted by name, without imports.

    Of two distributions with one name the first that has a group counts: an outdated `*.egg-info`, which comes first in
    a checkout's own folder, has the groups of its time.
    """
    return _read_entry_points(tuple(sys.path))


# `importlib.metadata` takes a fifth of a start: its import, and reading all distributions once for each group.
@cache
def _read_entry_points(folders: tuple[str, ...]) -> tuple[Registration, ...]:
    found: dict[tuple[str, str], list[Registration]] = {}
    for folder in folders:
        try:
            entries = [entry for entry in os.scandir(folder or ".") if entry.name.endswith((".dist-info", ".egg-info"))]
        except OSError:
            continue
        for entry in entries:
            distribution = entry.name.rpartition(".")[0].partition("-")[0].replace("_", "-").lower()
            try:
                text = Path(entry.path, "entry_points.txt").read_text(encoding="utf-8")
            except OSError:
                continue
            groups: dict[tuple[str, str], list[Registration]] = {}
            for point in _parse_entry_points(text, distribution):
                groups.setdefault((distribution, point.group), []).append(point)
            found = groups | found
    points = [point for each in found.values() for point in each]
    return tuple(sorted(points, key=lambda point: (point.name, point.value)))


def _parse_entry_points(text: str, distribution: str) -> Iterator[Registration]:
    group = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            group = line.strip("[]").strip()
        elif group.startswith("gslcosim.") and "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            value = value.partition("[")[0].strip()
            yield Registration(group=group, name=name.strip(), value=value, distribution=distribution)


@cache
def read_known() -> dict[str, dict[str, list[str]]]:
    """Return the offers of each of the project's own extensions, installed or not, by extension and kind."""
    known: dict[str, dict[str, list[str]]] = json.loads(Path(__file__).with_name("extensions.json").read_bytes())
    return known


def find_remedy(what: What, asked: str) -> str | None:
    """Return the sentence that names the extension with the requested thing, or None if none has it.

    Args:
        what: Kind of the thing.
        asked: Its name: `bench`, `agents[].start.ros2`, `suite`, `mcap`.
    """
    installed = {point.distribution for point in list_registrations()}
    for extension, offers in read_known().items():
        if asked in offers.get(what, ()) and f"gslcosim-{extension}" not in installed:
            return (
                f"It is in the extension {extension}, which is not installed: pip install gslcosim-{extension}, "
                f"or ./extensions/{extension} in a checkout"
            )
    return None


def find_name_remedy(name: str) -> str | None:
    """Return the sentence that names the extension with a public name, or None if none has it."""
    for extension, offers in read_known().items():
        if name in offers.get("names", ()):
            home = f"gslcosim_{extension}"
            is_absent = home in list_absent_modules()
            return find_remedy("names", name) if is_absent else f"It is in the extension {extension}: import {home}"
    return None


@cache
def list_absent_modules() -> tuple[str, ...]:
    """Return the modules of the project's own extensions that cannot be imported here."""
    modules = (module for offers in read_known().values() for module in offers.get("modules", ()))
    return tuple(module for module in modules if find_spec(module) is None)
