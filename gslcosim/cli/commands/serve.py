"""`gslcosim serve`: a warm server, from which `gslcosim up --warm` flies."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.cli.parsing import Command
from gslcosim.cli.terminal import finish_output, write
from gslcosim.errors import UsageError

if TYPE_CHECKING:
    from gslcosim.runtime.over_bus.forks import ForkServer

EXAMPLES = """  gslcosim serve                   in one shell, until Ctrl-C
  gslcosim up warehouse_empty --warm   in others, as often as wanted"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    # Titles of forks are written over the command line that the server was started with.
    parser.add_argument("--room-for-titles", default="", help=argparse.SUPPRESS)


def _run(arguments: argparse.Namespace) -> int:
    if sys.platform != "linux":
        raise UsageError("serve: expected Linux, where processes fork safely. Fly without --warm.")
    if not arguments.room_for_titles:
        _begin_anew()

    from gslcosim.runtime.over_bus.warm_server import serve_warm

    serve_warm(_fly, announce=_announce)
    return 0


# With one thread, also in libraries that read how many when they are loaded.
def _begin_anew() -> None:
    from gslcosim.command_lines import python_command
    from gslcosim.runtime.over_bus.forks import ONE_THREAD, ROOM_FOR_TITLES

    command = python_command("-m", "gslcosim", "serve", "--room-for-titles", ROOM_FOR_TITLES)
    finish_output()
    os.execve(command[0], command, {**os.environ, **ONE_THREAD})


def _announce(socket: Path) -> None:
    write(f"Flights begin from here with: gslcosim up SCENARIO --warm   (socket {socket}; Ctrl-C ends it)")
    finish_output()


def _fly(words: Sequence[str], fork_server: "ForkServer") -> int:
    from gslcosim.cli.commands.up import fly_with
    from gslcosim.cli.main import told_exit_code

    return told_exit_code(words, lambda arguments: fly_with(arguments, fork_server))


COMMAND = Command(
    name="serve",
    summary="keep a warm server for gslcosim up --warm, which has imported and rehearsed what flights share",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
