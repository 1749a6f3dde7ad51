"""`gslcosim`: the entry point. Heavy packages are imported only by the commands that need them."""

import argparse
import contextlib
import gc
import os
import sys
import traceback
from collections.abc import Callable, Sequence

from gslcosim import __version__
from gslcosim.base.disk_cache import limit_from_environment
from gslcosim.base.errors import (
    ExitCode,
    GslCosimError,
    MachineError,
    UsageError,
    check_address_space,
    check_working_directory,
    translate,
)
from gslcosim.base.extensions import COMMANDS_GROUP, list_registrations, load_registered, tuple_of
from gslcosim.base.processes import is_asked_to_end
from gslcosim.base.thread_limit import check_thread_limit
from gslcosim.cli.arguments import (
    Command,
    CommandFamily,
    CommandGroup,
    build_parser,
    find_command_name,
    merge_groups,
    parse,
)
from gslcosim.cli.commands import (
    cache,
    compare,
    completion,
    doctor,
    join,
    list_,
    monitor,
    replay,
    runs,
    up,
    validate,
    view,
)
from gslcosim.cli.terminal import (
    escape_library_messages,
    finish_output,
    give_up_output,
    open_missing_streams,
    write_note,
)

# New objects between two collections; Python's default is 700.
_COLLECT_EVERY = 50_000
_BUG = "This is a mistake in gslcosim: please report it with the lines above."

RUNS = CommandFamily(
    name="runs",
    summary="list runs, watch and stop those that are active",
    examples="  gslcosim runs                    the same as gslcosim runs list\n"
    "  gslcosim runs active\n  gslcosim runs top\n  gslcosim runs stop",
    parts=(runs.COMMAND, monitor.ACTIVE, monitor.TOP, monitor.STOP),
    default="list",
)
# Titles of the help, in this order; extensions add commands below them, and titles of their own.
CORE_GROUPS = (
    CommandGroup(
        title="run",
        commands=(up.UP, join.COMMAND, validate.COMMAND, replay.COMMAND),
    ),
    CommandGroup(title="look", commands=(list_.COMMAND, RUNS, view.COMMAND, compare.COMMAND)),
    CommandGroup(title="compare methods", commands=()),
    CommandGroup(title="environments", commands=()),
    CommandGroup(title="extend", commands=()),
    CommandGroup(title="machine", commands=(cache.COMMAND, completion.COMMAND, doctor.COMMAND)),
)


def list_groups() -> tuple[CommandGroup, ...]:
    """Return the commands of the core and of installed extensions, by the groups of the help."""
    registered = load_registered(COMMANDS_GROUP, tuple_of(CommandGroup), "a tuple of CommandGroup")
    found = [*CORE_GROUPS, *(group for groups in registered for group in groups)]
    commands: dict[str, Command] = {}
    for command in (each for group in found for each in group.commands if isinstance(each, Command)):
        if commands.setdefault(command.name, command) is not command:
            modules = f"one of {commands[command.name].run.__module__} and one of {command.run.__module__}"
            raise UsageError(
                f"{COMMANDS_GROUP}: expected one command {command.name!r}, was {modules}. "
                "Rename one, or uninstall its package."
            )
    return merge_groups(found)


def main(words: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # Imported objects stay: collecting garbage among them again and again would take a seventh of the start.
    gc.set_threshold(_COLLECT_EVERY)
    open_missing_streams()
    if words is None:
        if "_ARGCOMPLETE" in os.environ:
            groups = list_groups()
            completion.complete(build_parser(groups, version=__version__), groups)
        escape_library_messages()
    exit_code = run_command(sys.argv[1:] if words is None else words)
    if words is None and exit_code == ExitCode.FAULT:
        # Libraries wait at the interpreter's end for threads that could not start on a machine without memory.
        with contextlib.suppress(OSError):
            sys.stderr.flush()
        os._exit(exit_code)
    return exit_code


def run_command(words: Sequence[str], call: Callable[[argparse.Namespace], int] | None = None) -> int:
    """Run one command, report its errors, and return the exit code.

    Args:
        words: The command line without the program's name.
        call: Called with the parsed words; by default the command's own call.
    """
    try:
        exit_code = _exit_code_of(words, call)
        finish_output()
    except BrokenPipeError:
        give_up_output()
        return ExitCode.SUCCESS
    except MachineError as error:
        write_note(str(error))
        give_up_output()
        return error.exit_code
    return exit_code


def _exit_code_of(words: Sequence[str], call: Callable[[argparse.Namespace], int] | None) -> int:
    try:
        # Commands of the core need no other package.
        own = {each.name for group in CORE_GROUPS for each in group.commands if isinstance(each, Command)}
        groups = CORE_GROUPS if words and words[0] in own else list_groups()
        parser = build_parser(groups, version=__version__, only=find_command_name(groups, words))
        if not words:
            parser.print_help(sys.stderr)
            return ExitCode.USAGE
        arguments = parse(parser, groups, words)
        if "is_computing" in arguments:
            check_address_space()
            check_working_directory()
            check_thread_limit()
            limit_from_environment()
        return int((call or arguments.call)(arguments) or 0)
    except SystemExit:
        # The help or the version has been printed.
        finish_output()
        raise
    except KeyboardInterrupt:
        write_note("Interrupted.")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        raise
    except GslCosimError as error:
        write_note(str(error))
        return error.exit_code
    except Exception as error:
        if is_asked_to_end():
            # A library has turned the interrupt into another error.
            write_note("Interrupted.")
            return ExitCode.INTERRUPTED
        refused = translate(error)
        if refused is not None:
            write_note(str(refused))
            return refused.exit_code
        write_note(f"{traceback.format_exc()}gslcosim: internal error: {type(error).__name__}. {_name_culprit(error)}")
        return ExitCode.FAULT


# The package of another project that raised the error, if not gslcosim.
def _name_culprit(error: Exception) -> str:
    makers = {point.value.partition(":")[0].partition(".")[0]: point.distribution for point in list_registrations()}
    modules = [str(frame.f_globals.get("__name__")) for frame, _ in traceback.walk_tb(error.__traceback__)]
    last = next((top for name in modules[::-1] if (top := name.partition(".")[0]) in {"gslcosim", *makers}), "gslcosim")
    return _BUG if last.startswith("gslcosim") else f"This is a mistake in the extension {makers[last]}: correct it."
