"""Checks of the FMUs in a scenario before a run."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from gslcosim.base.errors import DataflowError, UsageError
from gslcosim.base.problems import Problem
from gslcosim.runtime.services import build_dataflow
from gslcosim.scenario import Scenario
from gslcosim_fmi.description import check_members, read_fmu
from gslcosim_fmi.scenario_keys import UNIT_START
from gslcosim_fmi.wiring import build_fmu_problem, wire_fmu


def find_fmu_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield what keeps the units of a scenario from taking part in its run.

    Args:
        directory: Its folder, where relative paths start.
    """
    try:
        types = build_dataflow(scenario).message_types
    except (UsageError, DataflowError):
        return  # which another check reports
    for i, own in enumerate(scenario.participants):
        unit = UNIT_START.get(own.start)
        if unit is not None:
            problems: list[Problem] = []
            if wire_fmu(own, scenario, directory, types, problems) is not None:
                try:
                    check_members(directory / Path(unit).expanduser())
                except UsageError as error:
                    problems.append(build_fmu_problem("start.fmu", error))
            for problem in problems:
                yield replace(problem, where=f"participants[{i}].{problem.where}")


def find_fmu_warnings(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield the units whose state no snapshot can hold, in scenarios with snapshots.

    Args:
        directory: Its folder, where relative paths start.
    """
    for i, own in enumerate(scenario.participants):
        file = UNIT_START.get(own.start)
        if file is None:
            continue
        try:
            unit = read_fmu(directory / Path(file).expanduser())
        except UsageError:
            continue  # which is a problem already
        if not unit.saves_state:
            yield Problem(
                where=f"participants[{i}].start.fmu",
                expected="a unit that can serialize its state, for snapshots",
                found=f"{unit.model}, which cannot",
                remedy="Snapshots hold its inputs instead: to go on there, it steps through all of them again.",
            )
