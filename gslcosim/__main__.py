"""The command `gslcosim`, and `python -m gslcosim`: what asks it to end is an orderly interruption from the start."""

import sys

from gslcosim.interruption import raise_on_signals


def main() -> int:
    """Run one command and return its exit code."""
    try:
        raise_on_signals()
        # Imported after signals are handled, since it takes a while.
        from gslcosim.cli.main import main as run_command

        return run_command()
    except KeyboardInterrupt:
        sys.stderr.write("Interrupted.\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
