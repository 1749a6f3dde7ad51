"""The command line as the freeze calls it: in this process, or as a process of its own."""

import contextlib
import hashlib
import io
import json
import signal
import subprocess
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

# Success, a failed agent: the run is as it should be.
ENDED = (0, 1)
# A run that lasts longer hangs.
LIMIT_S = 300
# Signals that a command handles while it runs.
HANDLED = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Skipped(Exception):  # noqa: N818 - it is no error
    """Something that this machine cannot compute, with the reason."""


class CommandFailed(Exception):  # noqa: N818
    """A command that ended with an exit code that it should not have."""


@dataclass(frozen=True)
class Ended:
    """A command that has ended: its exit code and what it has written."""

    exit_code: int
    output: str
    errors: str

    @property
    def fields(self) -> Any:
        """What it has written as JSON."""
        return json.loads(self.output)


@cache
def _main() -> Any:
    scripts = distribution("gslcosim").entry_points.select(group="console_scripts", name="gslcosim")
    return next(iter(scripts)).load()


def gslcosim(*words: str | Path, expected: tuple[int, ...] = (0,)) -> Ended:
    """Carry out a command in this process, which has imported everything already.

    Raises:
        CommandFailed: its exit code is not one of the expected.
        Skipped: it needs what this machine has not.
    """
    output, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(errors),
        warnings.catch_warnings(),
        _as_process("gslcosim", *map(str, words)),
    ):
        # JAX warns of forks in every process that has loaded it.
        warnings.simplefilter("ignore")
        try:
            exit_code = _main()()
        except SystemExit as end:
            exit_code = end.code if isinstance(end.code, int) else 1
    return _checked(words, Ended(exit_code or 0, output.getvalue(), errors.getvalue()), expected)


@contextlib.contextmanager
def _as_process(*words: str) -> Iterator[None]:
    """Give the command the words that a process of its own would have, and undo what it does to signals."""
    before, handlers = sys.argv, {each: signal.getsignal(each) for each in HANDLED}
    sys.argv = list(words)
    try:
        yield
    finally:
        sys.argv = before
        for each, handler in handlers.items():
            signal.signal(each, handler)


def gslcosim_apart(*words: str | Path, expected: tuple[int, ...] = (0,)) -> Ended:
    """Carry out a command in a process of its own.

    Raises:
        CommandFailed: its exit code is not one of the expected.
        Skipped: it needs what this machine has not.
    """
    process = start(*words)
    try:
        output, errors = process.communicate(timeout=LIMIT_S)
    except BaseException:
        process.terminate()
        process.communicate()
        raise
    return _checked(words, Ended(process.returncode, output, errors), expected)


def start(*words: str | Path) -> "subprocess.Popen[str]":
    """Start a command in a process of its own, which Ctrl-C on the freeze does not reach."""
    return subprocess.Popen(
        [sys.executable, "-m", "gslcosim", *map(str, words)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def _checked(words: tuple[str | Path, ...], ended: Ended, expected: tuple[int, ...]) -> Ended:
    if ended.exit_code in expected:
        return ended
    if "expected EGL or OSMesa" in ended.errors + ended.output:
        raise Skipped("cameras need EGL or OSMesa")
    call = " ".join(map(str, words))
    raise CommandFailed(
        f"gslcosim {call}: expected exit code {' or '.join(map(str, expected))}, was {ended.exit_code}: "
        f"{(ended.errors or ended.output).strip()[-800:]}"
    )


def hash_of(content: bytes | str) -> str:
    """Return a short hash of bytes or of a text."""
    data = content.encode() if isinstance(content, str) else content
    return hashlib.blake2b(data, digest_size=12).hexdigest()


def hash_of_fields(fields: Any) -> str:
    """Return a short hash of what JSON can carry, by value: every bit of a float counts."""
    return hash_of(json.dumps(fields, sort_keys=True))
