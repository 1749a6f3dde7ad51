"""Replaying, forking and comparing runs in the process of a test."""

import contextlib
import io
import json

from real_runs import UNRECORDED, Ended, Flight, start_command

from gslcosim.cli.main import main


def _run_here(words, runs_dir) -> Ended:
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        exit_code = main(words)
    text = output.getvalue()
    folders = sorted(runs_dir.glob("*/")) if runs_dir.is_dir() else []
    return Ended(exit_code, json.loads(text) if text else {}, folders[-1] if folders else None, errors.getvalue())


def replayed(run_dir, runs_dir, *arguments, is_recorded=False) -> Ended:
    """Replay a run in this process."""
    unrecorded = () if is_recorded else ("--no-recording",)
    return _run_here(["replay", str(run_dir), "--json", "--runs-dir", str(runs_dir), *unrecorded, *arguments], runs_dir)


def forked(run_dir, runs_dir, at_s, *arguments, in_process=True) -> Ended:
    """Fork a run, by default in this process."""
    words = ["fork", str(run_dir), "--at", str(at_s), "--json", "--runs-dir", str(runs_dir), *UNRECORDED, *arguments]
    if in_process:
        return _run_here([*words, "--in-process"], runs_dir)
    return Flight(start_command(words), runs_dir).end()


def compared(a, b) -> dict:
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        main(["compare", str(a), str(b), "--json"])
    return json.loads(output.getvalue())


def assert_same(past, fork):
    """Assert that a fork without changes ended as its run."""
    assert fork.exit_code == past.exit_code, (fork.errors, fork.result.get("faults"))
    assert fork.result["fork_of"]["divergence"] is None
    assert fork.result["digest"] == past.result["digest"]
