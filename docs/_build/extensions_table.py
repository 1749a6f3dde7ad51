"""Write `gslcosim/base/extensions.json`: what the project's own extensions offer, from their registrations.

Run with `make contract`, where all extensions are installed. The core reads the table to say which extension has what a
user asks for and has not installed; it decides nothing.
"""

import argparse
import json
import tomllib
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

from gslcosim.base.extensions import (
    CHECKS_GROUP,
    COMMANDS_GROUP,
    EXPORTERS_GROUP,
    GEOMETRY_GROUP,
    OPTIONS_GROUP,
    STARTS_GROUP,
    Registration,
    list_registered,
)
from gslcosim.base.scenario_keys import ScenarioKey
from gslcosim.cli.arguments import CommandFamily, CommandOptions
from gslcosim.scenario.checks.registry import SCENARIO
from gslcosim.scenario.models.gas import GAS_ENTRY_POINTS
from gslcosim.scenario.models.wind import WIND_ENTRY_POINTS
from gslcosim_bench.suite_kinds import SUITE_KINDS_GROUP, SuiteKind
from gslcosim_data.log_readers import LOG_READERS_GROUP

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "gslcosim" / "base" / "extensions.json"
# A package that registers something, with one word that a user may write for it.
Offer = tuple[Registration, str]


def list_commands() -> Iterator[Offer]:
    """Yield commands, actions as `bench run`, options as `up --ros2`, and suites as `bench run measured`."""
    for point in list_registered(COMMANDS_GROUP):
        for command in (command for group in point.load() for command in group.commands):
            if command.summary:
                yield point, command.name
            if isinstance(command, CommandFamily):
                yield from ((point, f"{command.name} {part.name}") for part in command.parts)
    for point in list_registered(OPTIONS_GROUP):
        yield from ((point, f"{point.name.replace('.', ' ')} {option}") for option in _list_options(point.load()))
    for point in list_registered(SUITE_KINDS_GROUP):
        kind = point.load()
        yield from ((point, f"bench run {word}") for word in (kind.name, *_list_options(kind)))


def _list_options(offered: CommandOptions | SuiteKind) -> list[str]:
    parser = argparse.ArgumentParser(add_help=False)
    offered.add_arguments(parser)
    return [text for action in parser._actions for text in action.option_strings]


def list_formats() -> Iterator[Offer]:
    """Yield formats that are written, and those of logs that are read, as `bag log`."""
    for point in list_registered(EXPORTERS_GROUP):
        yield from ((point, exporter.name) for exporter in point.load())
    for point in list_registered(LOG_READERS_GROUP):
        yield from ((point, f"{name} log") for name in point.load().formats)


def list_keys() -> Iterator[Offer]:
    """Yield the keys of scenarios that extensions add or read, such as `agents[].start.ros2`, and models by name."""
    for point in list_registered(STARTS_GROUP):
        keys: list[ScenarioKey[Any]] = [key for key in point.load() if isinstance(key, ScenarioKey)]
        yield from ((point, f"{key.place}.{key.name}".lstrip(".")) for key in keys)
    yield from ((point, point.name) for point in list_registered(GEOMETRY_GROUP))
    for place, group in (("gas.model", GAS_ENTRY_POINTS), ("wind.solver", WIND_ENTRY_POINTS)):
        yield from ((point, f"{place}={point.name}") for point in list_registered(group))


def list_files() -> Iterator[Offer]:
    """Yield kinds of files, such as `suite`."""
    for point in list_registered(CHECKS_GROUP):
        if not point.name.startswith(f"{SCENARIO}."):
            yield point, point.name


KINDS: dict[str, Callable[[], Iterator[Offer]]] = {
    "commands": list_commands,
    "formats": list_formats,
    "keys": list_keys,
    "files": list_files,
}


def build_table() -> dict[str, dict[str, list[str]]]:
    """Return what each extension offers, by the extension and the kind of thing."""
    files = sorted((ROOT / "extensions").glob("*/pyproject.toml"))
    names = [tomllib.loads(file.read_text(encoding="utf-8"))["project"]["name"] for file in files]
    table: dict[str, dict[str, list[str]]] = {name.removeprefix("gslcosim-"): {} for name in names}
    for kind, list_offers in KINDS.items():
        for point, word in list_offers():
            offers = table.get(point.distribution.removeprefix("gslcosim-"))
            if offers is not None and word not in offers.setdefault(kind, []):
                offers[kind].append(word)
    for name, offers in table.items():
        module = f"gslcosim_{name}"
        offers["modules"] = [module]
        # Names that stood in the package of the core, as `gslcosim.open_run`.
        offers["names"] = [name, *getattr(import_module(module), "__all__", ())]
    return {name: {kind: sorted(words) for kind, words in offers.items()} for name, offers in table.items()}


if __name__ == "__main__":
    TABLE.write_text(json.dumps(build_table(), indent=1, sort_keys=True) + "\n", encoding="utf-8")
