"""Words that a shell offers for arguments, by the argument names that all commands share."""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from gslcosim.base.bundled import bundled_agents, bundled_scenarios, bundled_suites
from gslcosim.cli.arguments import RUNS_DIR, FindWords


def find_named(find: Callable[[], Iterable[str]]) -> FindWords:
    """Return a source of words that do not depend on the command line."""
    return lambda _prefix, _arguments: find()


def find_separated(find: Callable[[], Iterable[str]]) -> FindWords:
    """Return a source of words for a list that is separated by commas."""
    return lambda prefix, _arguments: [f"{prefix[: prefix.rfind(',') + 1]}{word}" for word in find()]


def find_files(*endings: str) -> FindWords:
    """Return a source of files of the given endings, or of all files."""

    def find(prefix: str, _: argparse.Namespace) -> Iterable[str]:
        from argcomplete.completers import FilesCompleter

        return _without_hidden(FilesCompleter(endings)(prefix), prefix)

    return find


def find_folders(prefix: str, _: argparse.Namespace) -> Iterable[str]:
    """Offer folders."""
    from argcomplete.completers import DirectoriesCompleter

    return _without_hidden(DirectoriesCompleter()(prefix), prefix)


# As in shells: hidden names are offered only after a dot.
def _without_hidden(paths: Iterable[str], prefix: str) -> Iterable[str]:
    start = prefix.rfind("/") + 1
    return [path for path in paths if path[start : start + 1] != "." or prefix[start:]]


def find_run_ids(_: str, arguments: argparse.Namespace) -> Iterable[str]:
    """Offer the runs of the folder of runs that the command line names."""
    folder = Path(getattr(arguments, "runs_dir", RUNS_DIR))
    return [path.name for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []


def _list_services() -> Iterator[str]:
    from gslcosim.base.plugins import EntryPoints

    for group in ("gslcosim.default_services", "gslcosim.services"):
        yield from EntryPoints(group=group, what="service").names()


# Slow, half a second: it imports the models of scenarios.
def _list_layouts() -> Iterable[str]:
    from gslcosim.cli.commands.list_ import KINDS

    return [row["name"] for row in KINDS["layouts"]()]


SCENARIOS, SUITES, AGENTS = find_named(bundled_scenarios), find_named(bundled_suites), find_named(bundled_agents)
YAML_FILES = find_files("yaml", "yml")
# By the name of an argument in its help, or by an option. `Command.completes` holds those of one command.
COMPLETIONS: Mapping[str, Sequence[FindWords]] = {
    "SCENARIO": [SCENARIOS, YAML_FILES],
    "SCENARIO_OR_LAYOUT": [SCENARIOS, find_named(_list_layouts), YAML_FILES],
    "SUITE": [SUITES, YAML_FILES],
    "--entry": [AGENTS, find_files("py")],
    "[NAME=]AGENT": [AGENTS, find_files("py")],
    "SERVICE": [find_named(_list_services), find_named(lambda: ("agent",))],
    "SERVICE,…": [find_separated(_list_services), find_separated(lambda: ("all",))],
    "ENV_OR_RUN": [find_run_ids, SCENARIOS, find_folders],
    "CSV": [find_files("csv")],
    "JOIN_FILE": [find_files("json")],
    **dict.fromkeys(("RUN", "A", "B"), (find_run_ids, find_folders)),
    **dict.fromkeys(("DIR", "ENV", "FOLDER", "RESULTS"), (find_folders,)),
    **dict.fromkeys(("FILE", "FOLDER_OR_FILE", "PATH", "LOG", "COMMAND"), (find_files(),)),
}
