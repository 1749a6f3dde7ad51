"""Argument parser with its commands, and errors that name what was probably meant."""

import argparse
import difflib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn

from gslcosim.base.errors import UsageError
from gslcosim.cli.terminal import write, write_note

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


# Its value may begin with a minus.
_SORT = "--sort"


@dataclass(frozen=True, kw_only=True)
class Command:
    """One command: its name, what it does, examples, its arguments, and the call that returns the exit code."""

    name: str
    summary: str
    examples: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def run_action(arguments: argparse.Namespace) -> int:
    """Run the action of a command that has several, each with its own `act`; return the exit code."""
    return int(arguments.act(arguments))


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are ours to write."""

    def __init__(self, **options: Any) -> None:
        """Take what an argument parser takes."""
        super().__init__(**options)
        # From Python 3.14 on help has escape sequences of its own, which our output would show as text.
        self.color = False

    def error(self, message: str) -> NoReturn:
        """Raise what is wrong with the call.

        Raises:
            UsageError: always.
        """
        raise UsageError(f"{self.prog}: {message}. See {self.prog} --help.")

    # Python's own swallows what the machine refuses.
    def _print_message(self, message: str, file: "SupportsWrite[str] | None" = None) -> None:
        tell = write if file is sys.stdout else write_note
        tell(message.removesuffix("\n"))


def build_parser(commands: Sequence[Command], *, version: str) -> Parser:
    """Return the parser of `gslcosim` with all its commands."""
    parser = Parser(
        prog="gslcosim",
        description="Co-simulation for gas source localization: wind, gas, robots and agents in any language.",
        epilog=_examples("  gslcosim up warehouse_empty\n  gslcosim view\n  gslcosim doctor")
        + "\nexit codes:\n  0 success   1 the agent failed   2 wrong call or scenario   3 simulation fault"
        "\n  4 timeout   5 runs differ   130 interrupted",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"gslcosim {version}", help="print the version and exit")
    choices = parser.add_subparsers(dest="command", metavar="COMMAND", title="commands", parser_class=Parser)
    for command in commands:
        one = choices.add_parser(
            command.name,
            help=command.summary,
            description=f"{command.summary[:1].upper()}{command.summary[1:]}.",
            epilog=_examples(command.examples),
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        command.add_arguments(one)
        one.set_defaults(call=command.run)
    return parser


def parse(parser: Parser, commands: Sequence[Command], words: Sequence[str]) -> argparse.Namespace:
    """Return the parsed words of a command line, and these as `command_line`.

    Raises:
        UsageError: an unknown command or option, or a wrong value; names the nearest known one.
    """
    names = [command.name for command in commands]
    first = next((word for word in words if not word.startswith("-")), None)
    if first is not None and first not in names and words[0] == first:
        raise UsageError(
            f"gslcosim: expected one of the commands {', '.join(names)}, was '{first}'.{_hint(first, names)}"
        )
    arguments, unknown = parser.parse_known_args(_joined(words))
    if unknown:
        raise UsageError(_unknown_words(parser, arguments.command, unknown))
    arguments.command_line = tuple(words)
    return arguments


# The parser takes a value that begins with a minus for an option.
def _joined(words: Sequence[str]) -> list[str]:
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


def parse_positive_number(text: str) -> int:
    """Return a whole number of at least 1 from the command line."""
    number = parse_whole_number(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, was '{text}'")
    return number


def _unknown_words(parser: Parser, command: str | None, unknown: list[str]) -> str:
    program = f"{parser.prog} {command}" if command else parser.prog
    option = next((word for word in unknown if word.startswith("-")), None)
    if option is None:
        return f"{program}: expected no further words, was '{' '.join(unknown)}'. See {program} --help."
    name = option.partition("=")[0]
    known = sorted(_options_of(parser, command))
    return f"{program}: expected one of the options {', '.join(known)}, was '{name}'.{_hint(name, known)}"


def _options_of(parser: Parser, command: str | None) -> set[str]:
    chosen = command_parsers(parser)[command] if command else parser
    return {text for action in collect_actions(chosen) for text in action.option_strings if text.startswith("--")}


def collect_actions(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    """Return what a command takes, with what the actions below it take."""
    nested = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    below = [item for action in nested for choice in action.choices.values() for item in collect_actions(choice)]
    return [*parser._actions, *below]


def command_parsers(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Return the parsers of the commands by name."""
    actions = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
    return dict(actions[0].choices)


def _hint(word: str, known: Sequence[str]) -> str:
    matches = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f" Did you mean {matches[0]}?" if matches else ""


def _examples(text: str) -> str:
    return f"examples:\n{text}\n"
