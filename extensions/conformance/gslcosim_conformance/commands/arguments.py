"""Arguments that the commands for authors of agents and of participants have in common."""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from gslcosim.cli.arguments import build_number_parser


def add_checked_program_arguments(
    parser: argparse.ArgumentParser, program: str, *, doors: Sequence[str], door_help: str
) -> None:
    """Add the command of a program that is checked, and how it is connected; the first door is the default."""
    parser.add_argument("words", nargs="+", metavar="COMMAND", help=f"command that starts the {program}, after --")
    parser.add_argument("--door", choices=doors, default=doors[0], help=f"{door_help} (default: {doors[0]})")
    parser.add_argument(
        "--format", choices=("msgpack", "json"), default="msgpack", help="frames of the gateway (default: msgpack)"
    )


def add_answer_timeout_option(parser: argparse.ArgumentParser, program: str, *, default_s: float) -> None:
    """Add how long a program that is checked may take for an answer."""
    parser.add_argument(
        "--timeout",
        type=build_number_parser("a number of seconds above 0", lambda seconds: 0.0 < seconds < 1e6),
        default=default_s,
        metavar="S",
        help=f"how long the {program} may take for an answer, in seconds (default: {default_s:g})",
    )


def add_template_arguments(languages: str, name: str) -> Callable[[argparse.ArgumentParser], None]:
    """Return what adds the arguments of a command that writes a program to begin with.

    Args:
        languages: Help on the language.
        name: Help on the program's name.
    """

    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("language", metavar="LANGUAGE", help=languages)
        parser.add_argument("name", metavar="NAME", help=name)
        parser.add_argument(
            "--dir", type=Path, metavar="DIR", help="folder to write (default: NAME in the working directory)"
        )

    return add_arguments
