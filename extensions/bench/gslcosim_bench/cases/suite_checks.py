"""Checks of a suite file before its cases are made: scenarios that are not there, entries that cannot be started."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from gslcosim.base.bundled import bundled_families, bundled_scenarios
from gslcosim.base.errors import MethodError, ScenarioError
from gslcosim.base.problems import Problem
from gslcosim.methods.card import CARD_FILE, find_unmet_needs
from gslcosim.scenario.checks.program_checks import find_command_problem, find_python_problem
from gslcosim.scenario.loader import find_scenario
from gslcosim.scenario.problems import did_you_mean
from gslcosim_bench.cases.agent_setup import find_card
from gslcosim_bench.cases.families import find_family
from gslcosim_bench.cases.models import EntrySpec, Suite


def find_scenario_problems(suite: Suite, directory: Path) -> Iterator[Problem]:
    """Yield a problem for each scenario of a suite that is not there.

    Args:
        directory: Its folder, where relative paths start.
    """
    for i, spec in enumerate(suite.scenarios):
        beside = directory / spec.source
        is_family = spec.split is not None
        kind, bundled = ("family", bundled_families()) if is_family else ("scenario", bundled_scenarios())
        try:
            (find_family if is_family else find_scenario)(beside if beside.is_file() else spec.source)
        except ScenarioError:
            yield Problem(
                where=f"scenarios[{i}]",
                expected=f"a {kind} file beside the suite, or a bundled {kind}",
                found=f"'{spec.source}'",
                remedy=did_you_mean(spec.source, bundled) or f"There is no {beside}.",
            )


def find_entry_problems(suite: Suite, directory: Path) -> Iterator[Problem]:
    """Yield what keeps entries of a suite from being started: program, method card and parameters.

    Whether an entry has the sensors that its method needs depends on the scenario, and is checked case by case.

    Args:
        directory: Its folder, where relative paths start.
    """
    for i, entry in enumerate(suite.entries):
        problems = [*_find_program_problems(entry, directory)] or [*_find_card_problems(entry, directory)]
        yield from (replace(problem, where=f"entries[{i}].{problem.where}") for problem in problems)


def _find_program_problems(entry: EntrySpec, directory: Path) -> Iterator[Problem]:
    start, problem = entry.start, None
    if start.python is not None:
        problem = find_python_problem(start.python, directory=directory, path="start.python")
    elif start.command:
        problem = find_command_problem(start.command, directory=directory, path="start.command")
    if problem is not None:
        yield problem


def _find_card_problems(entry: EntrySpec, directory: Path) -> Iterator[Problem]:
    try:
        card = find_card(entry, directory)
    except MethodError as error:
        text, _, file = str(error).rpartition("\nFile: ")
        yield Problem(
            where="start",
            expected=f"an agent with a right {CARD_FILE}",
            found="one whose card is not",
            remedy=f"{file}: {text.rstrip('.')}.",
        )
        return
    if card is None:
        return
    for key, given in [("parameters", entry.parameters), *_list_special_parameters(entry)]:
        for need in find_unmet_needs(card, sensors=(), knows=(), n_channels=0, parameters=given):
            # The others are about the scenario.
            if need.where.startswith("parameters."):
                place = f"{key}.{need.where.removeprefix('parameters.')}"
                yield Problem(where=place, expected=need.expected, found=need.found, remedy=need.remedy)


def _list_special_parameters(entry: EntrySpec) -> Iterator[tuple[str, dict[str, object]]]:
    for scenario, given in entry.parameters_in.items():
        yield f"parameters_in.{scenario}", dict(given)
    for name, values in entry.vary.items():
        for value in values:
            yield "vary", {name: value}
