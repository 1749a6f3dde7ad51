"""Workers of `gslcosim bench`: the options that ask for them, the pool that is started, and runs that are repeated."""

import argparse
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from gslcosim.base.errors import UsageError
from gslcosim.cli.arguments import parse_positive_number
from gslcosim.cli.progress import ProgressLine
from gslcosim.cli.terminal import write_note, write_prompt

if TYPE_CHECKING:
    from gslcosim_bench.cases import LoadedSuite, Plan
    from gslcosim_bench.cases.models import LimitsSpec, Trial
    from gslcosim_bench.execution.pool import Pool
    from gslcosim_bench.execution.runner import StaleRows
    from gslcosim_bench.execution.verification import RepeatableResults, Verification


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    """Add where runs are flown: on so many cores of this machine, or on a cluster."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--jobs",
        type=parse_positive_number,
        metavar="N",
        help="number of workers on this machine (default: one per core)",
    )
    where.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="run on a Ray cluster: its address, auto, or local (pip install gslcosim-bench[ray])",
    )


def add_yes_option(parser: argparse.ArgumentParser) -> None:
    """Add the answer to the question of `confirm_put_aside`."""
    parser.add_argument("--yes", action="store_true", help="move results of another version aside without asking")


def confirm_put_aside(arguments: argparse.Namespace) -> "Callable[[StaleRows], bool]":
    """Return what asks before rows of another version are moved aside; who has nobody to ask refuses."""

    def confirm(stale: "StaleRows") -> bool:
        if not arguments.yes and not (sys.stdin.isatty() and sys.stderr.isatty()):
            raise UsageError(
                f"{stale.folder}: expected results of this version, was a folder in which {stale}. "
                "Repeat with --yes to move them to a folder beside and run them again, or name another folder with "
                "--results."
            )
        write_note(f"{stale.folder}: {stale}. They are moved to a folder beside and run again.")
        return arguments.yes or _ask("Continue?")

    return confirm


# The end of the input is a no.
def _ask(question: str) -> bool:
    write_prompt(f"{question} [y/N] ")
    return sys.stdin.readline().strip().lower().startswith("y")


def check_sandbox_here(arguments: argparse.Namespace, plan: "Plan") -> None:
    """Refuse a plan that demands a sandbox which this machine does not have; nodes of a cluster tell run by run."""
    from gslcosim_bench.execution.verification import check_machine

    if arguments.ray is None:
        check_machine(plan)


def choose_loader(arguments: argparse.Namespace) -> "Callable[..., LoadedSuite]":
    """Return what reads suites: `load_suite`, or what an option of an extension has set in its place."""
    from gslcosim_bench.cases import load_suite

    return arguments.load_suite or load_suite


def add_trusted(parser: argparse.ArgumentParser) -> None:
    """Add whether programs of results are started as their suite says."""
    parser.set_defaults(load_suite=None)
    parser.add_argument(
        "--trusted",
        action="store_true",
        help=(
            "start programs as the suite says, and Python agents in processes of this command "
            "(default: all in a sandbox)"
        ),
    )


def verify_here(
    arguments: argparse.Namespace, again: "RepeatableResults", trials: "Sequence[Trial]", contents: str
) -> "Verification":
    """Run trials of results again where the command line asks for, and compare them with their rows.

    Args:
        contents: The `results_hash` of their folder, from before its signature was checked.
    """
    from gslcosim_bench.execution.verification import check_confinable, verify_trials
    from gslcosim_bench.verification_marks import prepare_marks

    if not trials:
        raise UsageError(f"{again.folder.path}: expected flights with a result, found none.")
    check_sandbox_here(arguments, again.plan)
    check_confinable(trials, again.folder.path, is_trusted=arguments.trusted)
    prepare_marks()
    pool = start_pool(arguments, again.plan.loaded.suite.limits)
    try:
        with ProgressLine("verifying", is_quiet=arguments.json) as line:
            return verify_trials(again, trials, pool, line.count, contents=contents, is_trusted=arguments.trusted)
    finally:
        pool.close()


def start_pool(arguments: argparse.Namespace, limits: "LimitsSpec") -> "Pool":
    """Return the started workers that a command line asks for."""
    if arguments.ray is not None:
        from gslcosim_bench.execution.ray_pool import RayPool

        return RayPool(arguments.ray, limits)
    from gslcosim_bench.execution.pool import LocalPool, n_cores

    n_jobs = arguments.jobs or n_cores()
    if n_jobs > 4 * n_cores():
        write_note(f"--jobs: {n_jobs} workers on {n_cores()} cores take turns.")
    return LocalPool(n_jobs, limits)
