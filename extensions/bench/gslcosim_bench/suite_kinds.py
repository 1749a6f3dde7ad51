"""Suites that extensions register and run by themselves, such as one whose gas is measured."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass

from gslcosim.base.extensions import instance_of, load_registered

SUITE_KINDS_GROUP = "gslcosim.suite_kinds"


@dataclass(frozen=True, kw_only=True)
class SuiteKind:
    """A suite of which no run is planned: `bench run` calls its package.

    Attributes:
        name: The word for it in place of a suite file.
        question: What it answers, for lists.
        options: Names of options of its own, which no other suite takes; each has the default None.
        add_arguments: Adds these options to `bench run`.
        run: Runs it with the parsed words of `bench run` and returns the exit code.
    """

    name: str
    title: str
    question: str
    options: tuple[str, ...]
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def list_suite_kinds() -> dict[str, SuiteKind]:
    """Return the suites that installed extensions register, by name."""
    return {kind.name: kind for kind in load_registered(SUITE_KINDS_GROUP, instance_of(SuiteKind), "a SuiteKind")}
