"""Extensions: installed packages that add commands, checks and blocks by entry points, and the answer for absent ones.

The core finds extensions by the entry points of their distributions and spells the name of none. What the project's own
extensions offer stands in `extensions.json` beside this module, which `make contract` writes from their registrations:
it decides nothing, and is read only to say which extension has what is asked for and how it is installed.
"""

import json
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Literal, TypeVar

from gslcosim.base.errors import UsageError

# Packages and modules whose code decides the results of runs.
RESULT_CODE_GROUP = "gslcosim.result_code"
COMMANDS_GROUP = "gslcosim.commands"
CHECKS_GROUP = "gslcosim.checks"
STARTS_GROUP = "gslcosim.starts"
EXPORTERS_GROUP = "gslcosim.exporters"
GEOMETRY_GROUP = "gslcosim.geometry"
AGENTS_GROUP = "gslcosim.agents"

Offered = TypeVar("Offered")
# What a user may ask for: a word of the command line, a dotted key of a file, a kind of file, a format, a Python name.
What = Literal["commands", "keys", "files", "formats", "names", "modules"]


def load_registered(
    group: str,
    expected: Callable[[object], Offered | None],
    what: str,
    is_wanted: Callable[[str], bool] = lambda name: True,
) -> Iterator[Offered]:
    """Yield what installed extensions register in a group of entry points, in the order of the points' names.

    Args:
        group: The group, such as `COMMANDS_GROUP`.
        expected: Returns what is wanted from a registered object, or None where it is something else.
        what: The word for what is wanted, for the error.
        is_wanted: Returns whether the entry point of a name is wanted; others are not imported.

    Raises:
        UsageError: a package cannot be imported, or registers something else.
    """
    for point in list_registered(group):
        if not is_wanted(point.name):
            continue
        try:
            offered: object = point.load()
        # A package of another project may raise anything when it is imported.
        except Exception as error:
            raise UsageError(
                f"{group} {point.name}: expected {point.value} to be imported, was {error!r}. "
                f"Install {_name_distribution(point)} again, or uninstall it."
            ) from error
        accepted = expected(offered)
        if accepted is None:
            raise UsageError(
                f"{group} {point.name}: expected {what} in {point.value}, was {offered!s:.60}. "
                f"Install {_name_distribution(point)} again, or uninstall it."
            )
        yield accepted


def list_registered(group: str) -> list[EntryPoint]:
    """Return the entry points of a group, sorted by name, importing nothing."""
    return sorted(entry_points(group=group), key=lambda point: (point.name, point.value))


def _name_distribution(point: EntryPoint) -> str:
    return point.dist.name if point.dist is not None else "the package"


@cache
def read_known() -> dict[str, dict[str, list[str]]]:
    """Return what each of the project's own extensions offers, whether installed or not, by extension and kind."""
    known: dict[str, dict[str, list[str]]] = json.loads(Path(__file__).with_name("extensions.json").read_bytes())
    return known


def find_remedy(what: What, asked: str) -> str | None:
    """Return the sentence that names the extension which has what was asked for, or None where none is known.

    Args:
        what: The kind of thing.
        asked: Its name: `bench`, `agents[].start.ros2`, `suite`, `mcap`.
    """
    for extension, offers in read_known().items():
        if asked in offers.get(what, ()):
            return f"It is in the extension {extension}, which is not installed: pip install gslcosim-{extension}"
    return None
