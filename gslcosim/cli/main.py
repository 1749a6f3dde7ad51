"""`gslcosim`: the entry point. Heavy packages are imported only by the command that needs them."""

import gc
import os
import sys
from collections.abc import Sequence

from gslcosim import __version__
from gslcosim.cli.commands import (
    agent,
    bench,
    compare,
    doctor,
    export,
    generate,
    import_,
    listing,
    replay,
    sample,
    schema,
    sweep,
    tune,
    up,
    validate,
    view,
)
from gslcosim.cli.parsing import build_parser, parse
from gslcosim.cli.terminal import write_note
from gslcosim.errors import ExitCode, GslCosimError

# New objects between two collections; Python's own number is 700.
_COLLECT_EVERY = 50_000

COMMANDS = (
    up.COMMAND,
    bench.COMMAND,
    sweep.COMMAND,
    tune.COMMAND,
    validate.COMMAND,
    listing.COMMAND,
    generate.COMMAND,
    import_.COMMAND,
    export.COMMAND,
    view.COMMAND,
    compare.COMMAND,
    replay.COMMAND,
    sample.COMMAND,
    agent.COMMAND,
    schema.COMMAND,
    doctor.COMMAND,
)


def main(words: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code.

    Args:
        words: The command line without the program's name; by default that of this process.
    """
    # What is imported stays: looking through it for garbage again and again would take a seventh of the start.
    gc.set_threshold(_COLLECT_EVERY)
    parser = build_parser(COMMANDS, version=__version__)
    words = sys.argv[1:] if words is None else words
    try:
        if not words:
            parser.print_help(sys.stderr)
            return ExitCode.USAGE
        arguments = parse(parser, COMMANDS, words)
        exit_code = int(arguments.call(arguments))
        sys.stdout.flush()
        return exit_code
    except KeyboardInterrupt:
        write_note("Interrupted.")
        return ExitCode.INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has gone; Python would complain once more when it flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except GslCosimError as error:
        write_note(str(error))
        return error.exit_code
