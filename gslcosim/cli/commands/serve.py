"""`gslcosim serve`: a warm server, from which `gslcosim up --warm` flies."""

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import Command
from gslcosim.cli.terminal import finish_output, write

if TYPE_CHECKING:
    from gslcosim.runtime.processes.fork_client import ForkServer

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

    from gslcosim.runtime.processes.daemon import serve_daemon

    serve_daemon(_fly, announce=_announce)
    return 0


# With one thread, also in libraries that read how many when they are loaded.
def _begin_anew() -> None:
    from gslcosim.base.command_lines import build_python_command
    from gslcosim.runtime.processes.fork_client import SINGLE_THREAD_VARIABLES, TITLE_PADDING

    command = build_python_command("-m", "gslcosim", "serve", "--room-for-titles", TITLE_PADDING)
    finish_output()
    os.execve(command[0], command, {**os.environ, **SINGLE_THREAD_VARIABLES})


def _announce(socket: Path) -> None:
    write(f"Flights begin from here with: gslcosim up SCENARIO --warm   (socket {socket}; Ctrl-C ends it)")
    finish_output()


def _fly(words: Sequence[str], fork_server: "ForkServer") -> int:
    from gslcosim.cli.commands.up import run_scenario
    from gslcosim.cli.main import run_command

    return run_command(words, lambda arguments: run_scenario(arguments, fork_server))


COMMAND = Command(
    name="serve",
    summary="keep a warm server for gslcosim up --warm, which has imported and warmed up what runs share",
    examples=EXAMPLES,
    add_arguments=_add_arguments,
    run=_run,
)
