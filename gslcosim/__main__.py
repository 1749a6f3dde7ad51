"""The command `gslcosim`, and `python -m gslcosim`: what asks it to end is an orderly interruption from the start."""

import sys

from gslcosim.base.processes import is_asked_to_end, raise_on_signals


def main() -> int:
    """Run one command and return its exit code."""
    exit_code = 130
    try:
        raise_on_signals()
        # Imported after signals are handled, since it takes a while.
        from gslcosim.cli.main import main as run_command

        # Some imports turn an interruption into nothing.
        if is_asked_to_end():
            raise KeyboardInterrupt
        exit_code = run_command()
    except KeyboardInterrupt:
        sys.stderr.write("Interrupted.\n")
    if exit_code == 130:
        # Python remembers an interruption of any exec(), such as those of dataclasses, until the next one that is
        # whole, and would end by SIGINT.
        exec("pass")
    return exit_code


if __name__ == "__main__":
    sys.exit(main())
