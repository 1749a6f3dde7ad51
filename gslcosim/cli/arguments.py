"""Argument parser with its commands, and arguments shared by several of them: paths of runs, and scenarios."""

import argparse
import difflib
import math
import shutil
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from gslcosim.base.errors import UsageError
from gslcosim.base.extensions import OPTIONS_GROUP, find_remedy, instance_of, load_registered
from gslcosim.cli.terminal import write, write_note

if TYPE_CHECKING:
    from _typeshed import SupportsWrite

    from gslcosim.base.quantities import Vec3
    from gslcosim.bus.interface import Certificate
    from gslcosim.scenario import LoadedScenario
    from gslcosim.scenario.loader import RandomPosition
    from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec

# The value may begin with a minus.
_SORT = "--sort"
# Candidates for an argument, from the prefix of the word and the arguments before it.
FindWords = Callable[[str, argparse.Namespace], Iterable[str]]
Run = Callable[[argparse.Namespace], int]
RUNS_DIR = "runs"
RECORDING = "recording.rrd"
DIGEST = "digest.json"
MANIFEST = "manifest.json"


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command: name, summary, examples, arguments, and the call that returns the exit code.

    Attributes:
        old_name: Former name that is still accepted in place of the new name and its family's, such as `sweep`.
        is_computing: The command loads everything that a run needs.
        completes: Words that a shell offers for an argument, by its name in the help or by an option. Arguments that
        are not here have those of `gslcosim.cli.completion_words`, or are numbers or free text.
    """

    name: str
    summary: str
    examples: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Run
    old_name: str = ""
    is_computing: bool = False
    completes: Mapping[str, Sequence[FindWords]] = field(default_factory=dict[str, Sequence[FindWords]])


@dataclass(frozen=True, kw_only=True)
class CommandFamily:
    """Commands that are called by two words, such as `bench run`.

    Attributes:
        summary: Clause for the help; empty where the parts join the family of another package.
        default: Name of the default part; without one, a part must be named.
    """

    name: str
    summary: str
    examples: str
    parts: tuple[Command, ...]
    is_computing: bool = False
    default: str = ""


@dataclass(frozen=True, kw_only=True)
class CommandGroup:
    """Commands that the help shows under one title."""

    title: str
    commands: tuple[Command | CommandFamily, ...]


@dataclass(frozen=True, kw_only=True)
class CommandOptions:
    """Options that an extension adds to a command of another package, registered by the command's words: `bench.run`.

    Attributes:
        run: Called with the parsed words and with the command's call, which it makes or replaces.
        completes: As of a `Command`.
    """

    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace, Run], int]
    completes: Mapping[str, Sequence[FindWords]] = field(default_factory=dict[str, Sequence[FindWords]])


def merge_groups(groups: Iterable[CommandGroup]) -> tuple[CommandGroup, ...]:
    """Return groups with unique titles, in which families have unique names.

    Args:
        groups: In the order of the help; commands of a title keep this order too. Of two commands with one name the
            first counts. A family takes its summary and its first parts from the one that has a summary.
    """
    merged: dict[str, dict[str, Command | CommandFamily]] = {}
    for group in groups:
        commands = merged.setdefault(group.title, {})
        for command in group.commands:
            known = commands.setdefault(command.name, command)
            if known is command or not (isinstance(known, CommandFamily) and isinstance(command, CommandFamily)):
                continue
            first, second = (known, command) if known.summary else (command, known)
            commands[command.name] = replace(first, parts=(*first.parts, *second.parts))
    return tuple(CommandGroup(title=title, commands=tuple(found.values())) for title, found in merged.items())


class Parser(argparse.ArgumentParser):
    """An argument parser that reports errors as `UsageError`."""

    def __init__(self, **options: Any) -> None:
        """Accept the options of an argument parser."""
        super().__init__(**options)
        # From Python 3.14 on help contains escape sequences, which our output would show as text.
        self.color = False
        self.completes: Mapping[str, Sequence[FindWords]] = {}

    def error(self, message: str) -> NoReturn:
        """Raise the error of a call."""
        raise UsageError(f"{self.prog}: {message}{'' if message[-1] in '.?' else '.'} See {self.prog} --help.")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            known = [str(choice) for choice in action.choices]
            hint = _format_hint(str(value), {text: text for text in known})
            raise argparse.ArgumentError(action, f"expected one of {', '.join(known)}, was '{value}'.{hint}")

    # Python's own method swallows errors of the stream.
    def _print_message(self, message: str, file: "SupportsWrite[str] | None" = None) -> None:
        write_line = write if file is sys.stdout else write_note
        write_line(message.removesuffix("\n"))


def build_parser(groups: Sequence[CommandGroup], *, version: str, only: str | None = None) -> Parser:
    """Return the parser of `gslcosim`."""
    parser = Parser(
        prog="gslcosim",
        usage="gslcosim [-h] [--version] COMMAND ...",
        description="Co-simulation for gas source localization: wind, gas, robots and agents in any language.",
        epilog=f"{_format_listing(groups)}\n"
        + _examples("  gslcosim up warehouse_empty\n  gslcosim view\n  gslcosim doctor")
        + "\nexit codes:\n  0 success   1 the agent failed   2 wrong call or scenario   3 simulation fault"
        "\n  4 timeout   5 runs differ   130 interrupted",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"gslcosim {version}", help="print the version and exit")
    # The epilog lists the commands, in groups.
    choices = parser.add_subparsers(
        dest="command", metavar="COMMAND", prog="gslcosim", parser_class=Parser, help=argparse.SUPPRESS
    )
    for group in groups:
        for command in group.commands:
            if only is None or command.name == only:
                _add_command(choices, command, command.name)
    return parser


def _add_command(choices: "argparse._SubParsersAction[Parser]", command: Command | CommandFamily, path: str) -> None:
    parser = choices.add_parser(
        command.name,
        help=command.summary,
        description=f"{command.summary[:1].upper()}{command.summary[1:]}.",
        epilog=_examples(command.examples),
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    if command.is_computing:
        parser.set_defaults(is_computing=True)
    if isinstance(command, CommandFamily):
        below = parser.add_subparsers(dest="action", metavar="ACTION", required=True, title="actions")
        for part in command.parts:
            _add_command(below, part, f"{path}.{part.name}")
        return
    command.add_arguments(parser)
    run, completes = command.run, dict(command.completes)
    for options in load_options(path):
        options.add_arguments(parser)
        run, completes = partial(_call_options, options, run), {**completes, **options.completes}
    parser.set_defaults(call=run)
    parser.completes = completes


def _call_options(options: CommandOptions, run: Run, arguments: argparse.Namespace) -> int:
    return options.run(arguments, run)


def load_options(path: str) -> list[CommandOptions]:
    """Return the options that installed extensions add to a command."""
    return list(load_registered(OPTIONS_GROUP, instance_of(CommandOptions), "a CommandOptions", name=path))


def _format_listing(groups: Sequence[CommandGroup]) -> str:
    # As in argparse, where the help of a command begins in column 24.
    width = max(shutil.get_terminal_size().columns - 2, 40)
    lines = ["commands:"]
    for group in (each for each in groups if each.commands):
        lines.append(f"  {group.title}:")
        for command in group.commands:
            first = f"    {command.name:<12}  "
            lines.append(textwrap.fill(command.summary, width, initial_indent=first, subsequent_indent=" " * 18))
    return "\n".join(lines) + "\n"


def iterate_commands(groups: Iterable[CommandGroup]) -> "Iterator[tuple[tuple[str, ...], Command]]":
    """Yield all commands, including those of families, each with the words that call it."""
    for each in (command for group in groups for command in group.commands):
        if isinstance(each, CommandFamily):
            yield from (((each.name, part.name), part) for part in each.parts)
        else:
            yield (each.name,), each


def find_command_name(groups: Iterable[CommandGroup], words: Sequence[str]) -> str:
    """Return the name of the command or family that a command line calls, also by an old name; else an empty text."""
    groups = tuple(groups)
    if words[:1] and any(words[0] == command.name for group in groups for command in group.commands):
        return words[0]
    return next((path[0] for path, command in iterate_commands(groups) if [command.old_name] == list(words[:1])), "")


def parse(parser: Parser, groups: Sequence[CommandGroup], words: Sequence[str]) -> argparse.Namespace:
    """Return the parsed words of a command line; an old name prints a note to stderr."""
    words = list(words)
    names = [command.name for group in groups for command in group.commands]
    moved = {command.old_name: path for path, command in iterate_commands(groups) if command.old_name}
    first = next((word for word in words if not word.startswith("-")), None)
    if first in moved and words[0] == first:
        path = moved[first]
        write_note(f"gslcosim {first}: is gslcosim {' '.join(path)} now; the old name ends with the next release.")
        words = [*path, *words[1:]]
        _parser_of(parser, path).prog = f"gslcosim {first}"
    elif first is not None and first not in names and words[0] == first:
        _check_installed(words[:2])
        _check_installed(words[:1])
        hint = _format_hint(
            first, {**{name: name for name in names}, **{old: " ".join(path) for old, path in moved.items()}}
        )
        raise UsageError(f"gslcosim: expected one of the commands {', '.join(names)}, was '{first}'.{hint}")
    elif tuple(words[:2]) not in dict(iterate_commands(groups)):
        _check_installed(words[:2])
    words = _with_default_part(parser, groups, words)
    arguments, unknown = parser.parse_known_args(_join_negative_values(words))
    if unknown:
        raise UsageError(_unknown_words(parser, words, unknown))
    return arguments


# Report words of an extension that is not installed in one sentence.
def _check_installed(words: Sequence[str]) -> None:
    called = " ".join(words)
    if remedy := find_remedy("commands", called):
        raise UsageError(f"gslcosim {called}: expected a command that is installed. {remedy}")


def _with_default_part(parser: Parser, groups: Sequence[CommandGroup], words: Sequence[str]) -> Sequence[str]:
    for family in (each for group in groups for each in group.commands if isinstance(each, CommandFamily)):
        if family.default and words[:1] == [family.name]:
            known = (*(part.name for part in family.parts), "-h", "--help")
            if words[1:2] and words[1] in known:
                return words
            _parser_of(parser, (family.name, family.default)).prog = f"gslcosim {family.name}"
            return [family.name, family.default, *words[1:]]
    return words


# The parser would read a value that begins with a minus as an option.
def _join_negative_values(words: Sequence[str]) -> list[str]:
    joined: list[str] = []
    for word in words:
        if joined and joined[-1] == _SORT and word.startswith("-") and not word.startswith("--"):
            joined[-1] = f"{_SORT}={word}"
        else:
            joined.append(word)
    return joined


def parse_whole_number(text: str) -> int:
    """Return a whole number of at least 0 from the command line."""
    if not text.isdigit():
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 0, was '{text}'")
    return int(text)


def build_number_parser(expected: str, is_allowed: Callable[[float], bool]) -> Callable[[str], float]:
    """Return a parser of finite numbers on the command line."""

    def parse_number(text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not (math.isfinite(number) and is_allowed(number)):
            raise argparse.ArgumentTypeError(f"expected {expected}, was '{text}'")
        return number

    return parse_number


def parse_positive_number(text: str) -> int:
    """Return a whole number of at least 1 from the command line."""
    number = parse_whole_number(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, was '{text}'")
    return number


def _unknown_words(parser: Parser, words: Sequence[str], unknown: list[str]) -> str:
    chosen = _parser_of(parser, words)
    option = next((word for word in unknown if word.startswith("-")), None)
    if option is None:
        return f"{chosen.prog}: expected no further words, was '{' '.join(unknown)}'. See {chosen.prog} --help."
    name = option.partition("=")[0]
    command = chosen.prog.removeprefix("gslcosim ")
    if remedy := find_remedy("commands", f"{command} {name}"):
        return f"{chosen.prog} {name}: expected an option that is installed. {remedy}"
    known = sorted({text for action in chosen._actions for text in action.option_strings if text[:2] == "--"})
    hint = _format_hint(name, {text: text for text in known})
    return f"{chosen.prog}: expected one of the options {', '.join(known)}, was '{name}'.{hint}"


# The innermost command named by the words, such as `bench run`.
def _parser_of(parser: argparse.ArgumentParser, words: Sequence[str]) -> argparse.ArgumentParser:
    for word in words:
        if word in (below := command_parsers(parser)):
            parser = below[word]
    return parser


def command_parsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the commands that a parser has, by name."""
    actions = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(actions[0].choices) if actions else {}


# `known` maps accepted words to the suggestion for each.
def _format_hint(word: str, known: Mapping[str, str]) -> str:
    matches = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f" Did you mean {known[matches[0]]}?" if matches else ""


def _examples(text: str) -> str:
    return f"examples:\n{text}\n"


def add_runs_dir_option(parser: argparse.ArgumentParser) -> None:
    """Add `--runs-dir`."""
    parser.add_argument(
        "--runs-dir", type=Path, default=Path(RUNS_DIR), metavar="DIR", help="folder of all runs (default: runs)"
    )


def find_in_run(run: str | None, *, runs_dir: Path, file_name: str) -> Path:
    """Return a file of a run.

    Args:
        run: The run's folder, the file itself, the run's id under `runs_dir` or the beginning of it; None is the
            newest run that has the file.
        runs_dir: The folder of all runs.
        file_name: The file's name within a run.
    """
    if run is None:
        return _find_newest(runs_dir, file_name)
    path = Path(run)
    if path.is_file():
        return path
    folders = [path] if path.is_dir() else _find_by_prefix(run, runs_dir)
    if len(folders) != 1:
        found = f"{len(folders)} that fit: {', '.join(p.name for p in folders[:5])}" if folders else "none"
        raise UsageError(f"{run}: expected a run's folder or the id of one run in {runs_dir}, found {found}.")
    file = folders[0] / file_name
    if not file.is_file():
        raise UsageError(f"{run}: expected a run with a {file_name}, found none. Has the run ended well?\nFile: {file}")
    return file


def _find_by_prefix(run_id: str, runs_dir: Path) -> list[Path]:
    if not runs_dir.is_dir():
        return []
    return sorted(path for path in runs_dir.iterdir() if path.is_dir() and path.name.startswith(run_id))


def _find_newest(runs_dir: Path, file_name: str) -> Path:
    files = sorted(runs_dir.glob(f"*/{file_name}"), key=lambda path: path.stat().st_mtime_ns)
    if not files:
        raise UsageError(
            f"{runs_dir}: expected a run with a {file_name}, found none. Fly one: gslcosim up warehouse_empty"
        )
    return files[-1]


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the scenario and the options that change it."""
    parser.add_argument("scenario", metavar="SCENARIO", help="a scenario file, or the name of a bundled scenario")
    add_override_options(parser)


def add_override_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that change a scenario."""
    parser.add_argument(
        "--seed", type=parse_whole_number, metavar="N", help="replace the seed of the scenario, for example 8"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="replace one value, for example agents[0].vehicle.hold_s=1; repeatable",
    )


def add_pace_option(parser: argparse.ArgumentParser, default: str = "as fast as it goes") -> None:
    """Add the option that ties simulated time to the clock."""
    parser.add_argument(
        "--pace",
        metavar="FACTOR",
        help=f"simulated seconds in a second, the same as --set pace=FACTOR (default: {default})",
    )


def load_checked(arguments: argparse.Namespace, *, prepares_run: bool = True) -> "LoadedScenario":
    """Return the scenario of a command line.

    Args:
        arguments: As parsed.
        prepares_run: The caller prepares a run, which reports problems of the files that it reads.
    """
    from gslcosim.scenario import load_scenario
    from gslcosim.scenario.checks.registry import list_scenario_checks

    # Where services start elsewhere, pictures are drawn there too.
    named = {name.strip() for words in getattr(arguments, "elsewhere", ()) for name in words.split(",")}
    pace = getattr(arguments, "pace", None)
    return load_scenario(
        arguments.scenario,
        overrides=[*arguments.set, *([] if pace is None else [f"pace={pace}"])],
        seed=arguments.seed,
        checks=list_scenario_checks(
            without=("drawing",) if named & {"all", "cameras"} else (),
            processes=getattr(arguments, "processes", None),
            prepares_run=prepares_run,
        ),
        placer=_draw_places,
    )


# Drawing needs a compiler; most scenarios give fixed positions.
def _draw_places(
    spec: "EnvironmentSpec", wind: "SolverSpec", scenario_dir: Path, seed: int, wanted: "Sequence[RandomPosition]"
) -> "Mapping[str, Vec3]":
    from gslcosim.environment.positions import draw_positions

    return draw_positions(spec, wind, scenario_dir, seed, wanted)


def read_certificate(arguments: argparse.Namespace) -> "Certificate | None":
    """Return the certificate of `--tls-certificate` and `--tls-key`, or None without both."""
    from gslcosim.bus.interface import Certificate

    given = [path for path in (arguments.tls_certificate, arguments.tls_key) if path is not None]
    if len(given) == 1:
        raise UsageError("expected --tls-certificate and --tls-key together, found one of them.")
    authorities = {name: getattr(arguments, f"tls_{name}", None) for name in ("ca", "client_ca")}
    if given:
        return Certificate(certificate=arguments.tls_certificate, private_key=arguments.tls_key, **authorities)
    if any(path is not None for path in authorities.values()):
        raise UsageError("expected --tls-certificate and --tls-key with --tls-ca or --tls-client-ca, found none.")
    return None
