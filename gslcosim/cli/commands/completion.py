"""`gslcosim completion`: the script that a shell completes words with, and the words that may stand at the cursor.

The script runs gslcosim itself with `_ARGCOMPLETE` in the environment and reads what it prints, so that words are
always those of the version, folder and packages at hand. argcomplete knows the shells, and which argument is meant.
"""

import argparse
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.bundled import (
    bundled_agents,
    bundled_families,
    bundled_scenarios,
    bundled_suites,
    bundled_train_files,
)
from gslcosim.base.disk_cache import FOLDERS
from gslcosim.base.plugins import EntryPoints
from gslcosim.cli.arguments import RUNS_DIR, Command, CommandFamily, CommandGroup, command_parsers
from gslcosim.cli.commands.plot import FIGURES
from gslcosim.cli.commands.runs import COLUMNS
from gslcosim.cli.terminal import write

SHELLS = ("bash", "zsh", "fish")
EXAMPLES = """  gslcosim completion bash > ~/.local/share/bash-completion/completions/gslcosim
  gslcosim completion zsh > ~/.zfunc/_gslcosim     where fpath has that folder
  gslcosim completion fish > ~/.config/fish/completions/gslcosim.fish"""

# Words that may stand for an argument, from the beginning of the word and the arguments before it.
FindWords = Callable[[str, argparse.Namespace], Iterable[str]]


def _named(find: Callable[[], Iterable[str]]) -> FindWords:
    return lambda _prefix, _arguments: find()


def _services() -> Iterator[str]:
    for group in ("gslcosim.default_services", "gslcosim.services"):
        yield from EntryPoints(group=group, what="service").names()


# It takes half a second, for the models of scenarios; the languages take a second.
def _layouts() -> Iterable[str]:
    from gslcosim.cli.commands.list_ import KINDS

    return [row["name"] for row in KINDS["layouts"]()]


def _agent_languages() -> Iterable[str]:
    from gslcosim_conformance.scaffold import list_languages

    return list_languages()


def _participant_languages() -> Iterable[str]:
    from gslcosim_conformance.scaffold import PARTICIPANT_SUFFIXES

    return PARTICIPANT_SUFFIXES


def _unit_sensors() -> tuple[str, ...]:
    from gslcosim_fmi.room_fmu import list_fmu_sensors

    return list_fmu_sensors()


def _picture_formats() -> Iterable[str]:
    from gslcosim_data.figures.style import FORMATS

    return FORMATS


def _run_ids(_: str, arguments: argparse.Namespace) -> Iterable[str]:
    folder = Path(getattr(arguments, "runs_dir", RUNS_DIR))
    return [path.name for path in folder.iterdir() if path.is_dir()] if folder.is_dir() else []


def _folders(prefix: str, _: argparse.Namespace) -> Iterable[str]:
    from argcomplete.completers import DirectoriesCompleter

    return _without_hidden(DirectoriesCompleter()(prefix), prefix)


def _files(*endings: str) -> FindWords:
    def find(prefix: str, _: argparse.Namespace) -> Iterable[str]:
        from argcomplete.completers import FilesCompleter

        return _without_hidden(FilesCompleter(endings)(prefix), prefix)

    return find


# As shells do: names that begin with a dot are asked for by a dot.
def _without_hidden(paths: Iterable[str], prefix: str) -> Iterable[str]:
    start = prefix.rfind("/") + 1
    return [path for path in paths if path[start : start + 1] != "." or prefix[start:]]


_SCENARIOS, _SUITES, _AGENTS = _named(bundled_scenarios), _named(bundled_suites), _named(bundled_agents)
_YAML_FILES = _files("yaml", "yml")
# By a command and the name of an argument in its help, or that name alone, or an option. What is not here and has no
# choices of its own is a number or a text of the user.
COMPLETIONS: Mapping[str, Sequence[FindWords]] = {
    "SCENARIO": [_SCENARIOS, _YAML_FILES],
    "SCENARIO_OR_LAYOUT": [_SCENARIOS, _named(_layouts), _YAML_FILES],
    "SUITE": [_SUITES, _YAML_FILES],
    "validate FILE": [_SCENARIOS, _SUITES, _named(bundled_families), _named(bundled_train_files), _AGENTS, _YAML_FILES],
    "bench sweep SUITE": [_SUITES, _SCENARIOS, _YAML_FILES],
    "bench tune SUITE": [_SUITES, _SCENARIOS, _YAML_FILES],
    "train FILE": [_named(bundled_train_files), _YAML_FILES],
    "--entry": [_AGENTS, _files("py")],
    "[NAME=]AGENT": [_AGENTS, _files("py")],
    "agent new LANGUAGE": [_named(_agent_languages)],
    "participant new LANGUAGE": [_named(_participant_languages)],
    "SERVICE": [_named(_services), _named(lambda: ("agent",))],
    "SERVICE,…": [_named(_services), _named(lambda: ("all",))],
    "NAMES": [_named(lambda: FIGURES)],
    "KINDS": [_named(_picture_formats)],
    "KIND": [_named(lambda: FOLDERS)],
    "MODELS": [_named(_unit_sensors)],
    "COLUMN": [_named(lambda: COLUMNS)],
    "ENV_OR_RUN": [_run_ids, _SCENARIOS, _folders],
    "environment export ENV": [_SCENARIOS, _folders],
    "CSV": [_files("csv")],
    "JOIN_FILE": [_files("json")],
    **dict.fromkeys(("RUN", "A", "B"), (_run_ids, _folders)),
    **dict.fromkeys(("DIR", "ENV", "FOLDER", "RESULTS"), (_folders,)),
    **dict.fromkeys(("FILE", "FOLDER_OR_FILE", "PATH", "LOG", "COMMAND"), (_files(),)),
}
_SEPARATED_BY_COMMAS = ("NAMES", "KINDS", "MODELS", "SERVICE,…")


def complete(parser: argparse.ArgumentParser, groups: Sequence[CommandGroup]) -> None:
    """Answer a shell that asks for words, on the descriptor that its script reads, and end the process."""
    import argcomplete

    for family in (each for group in groups for each in group.commands if isinstance(each, CommandFamily)):
        for part in family.parts:
            if part.name == family.default:
                _add_options(command_parsers(parser)[family.name], part)
    for action, sources in _pair_with_sources(parser):
        action.completer = _build_completer(sources, is_list=action.metavar in _SEPARATED_BY_COMMAS)
    nothing: Any = _build_completer((), is_list=False)
    argcomplete.autocomplete(parser, always_complete_options=False, default_completer=nothing)


# Those of the part that is meant where none is named.
def _add_options(parser: argparse.ArgumentParser, part: Command) -> None:
    options = argparse.ArgumentParser(add_help=False)
    part.add_arguments(options)
    for action in options._actions:
        if action.option_strings:
            parser._add_action(action)


def _pair_with_sources(parser: argparse.ArgumentParser) -> Iterator[tuple[Any, Sequence[FindWords]]]:
    command = parser.prog.removeprefix("gslcosim ")
    for action in (each for each in parser._actions if not each.choices):
        keys = (*action.option_strings, f"{command} {action.metavar}", str(action.metavar))
        if found := next((COMPLETIONS[key] for key in keys if key in COMPLETIONS), None):
            yield action, found
    for below in command_parsers(parser).values():
        yield from _pair_with_sources(below)


def _build_completer(sources: Sequence[FindWords], *, is_list: bool) -> Callable[..., Iterable[str]]:
    def find(prefix: str, parsed_args: argparse.Namespace, **_: Any) -> Iterable[str]:
        before = prefix[: prefix.rfind(",") + 1] if is_list else ""
        return [f"{before}{word}" for source in sources for word in source(prefix, parsed_args)]

    return find


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=f"{', '.join(SHELLS[:-1])} or {SHELLS[-1]}")


def _run(arguments: argparse.Namespace) -> int:
    from argcomplete.shell_integration import shellcode

    # Bash has no names of files of its own where none fits.
    write(shellcode(["gslcosim"], shell=arguments.shell, complete_arguments=["-o", "nospace"]).strip())
    return 0


COMMAND = Command(
    name="completion",
    summary=("print the script for completion of commands, options, scenarios, suites, methods and runs"),
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
