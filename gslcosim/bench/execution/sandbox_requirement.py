"""Sandbox requirement of suites: checked before anything runs, and in the rows."""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError
from gslcosim.bench.cases.plan import Plan
from gslcosim.bench.cases.trials import Trial
from gslcosim.runtime.agents.loader import build_start_command, find_python_agent, resolve_command
from gslcosim.runtime.processes.sandbox.policy import find_own_folders, is_system_path, list_python_folders
from gslcosim.runtime.processes.sandbox.selection import find_strongest_sandbox, is_sandboxed, unavailable_reason


def check_sandbox(plan: Plan) -> None:
    """Refuse to fly a suite that demands a sandbox on a machine without one.

    Raises:
        UsageError: there is none here.
    """
    if plan.loaded.demands_sandbox and find_strongest_sandbox() == "none":
        reasons = _reasons()
        raise UsageError(
            f"{plan.loaded.shown_path}: sandbox: expected a machine that has a sandbox for agents, was one without "
            f"({reasons}). Install bubblewrap, or fly the suite on another machine."
        )


def check_confinable(trials: Sequence[Trial], folder: Path) -> None:
    """Refuse to run trials of somebody else whose programs could not be confined, before any of them is started.

    Args:
        trials: The trials.
        folder: The results that they are of; their programs lie in it, or come with gslcosim or the system.

    Raises:
        UsageError: this machine has no sandbox, or a program would see or change more than it needs.
    """
    trusting = "If you trust who made these results, give --trusted: then their programs do as they like."
    if find_strongest_sandbox() == "none":
        raise UsageError(
            f"{folder}: expected a machine that has a sandbox for the programs of these results, was one without "
            f"({_reasons()}). Install bubblewrap. {trusting}"
        )
    for entry, program in {(trial.entry, program) for trial in trials for program in _python_programs(trial)}:
        if "__main__" not in program.read_text(encoding="utf-8", errors="replace"):
            raise UsageError(
                f"{folder}: {entry}: expected a Python agent that is also a program, which a sandbox can start, was "
                f"one without the line: if __name__ == '__main__': run(MyAgent). {trusting}\nFile: {program}"
            )
    allowed = [folder.resolve(), *(place.resolve() for place in list_python_folders())]
    seen: set[tuple[Any, ...]] = set()
    for trial in trials:
        for place, command, granted in _programs(trial):
            if (key := (place, tuple(command), granted, trial.directory)) in seen:
                continue
            seen.add(key)
            if granted:
                raise UsageError(
                    f"{folder}: {trial.entry}: {place}: expected a program that sees and changes its own folder alone, "
                    f"was one that asks for {granted[0]} (may_read, may_write). {trusting}"
                )
            for seen_folder in find_own_folders(command, trial.directory):
                if not any(seen_folder.resolve().is_relative_to(each) for each in allowed) and not is_system_path(
                    seen_folder.resolve()
                ):
                    raise UsageError(
                        f"{folder}: {trial.entry}: {place}.start: expected a command that names files of these results "
                        f"or of the system, was one that names something in {seen_folder}. {trusting}"
                    )


def confine_trial(trial: Trial) -> Trial:
    """Return a trial whose programs are processes in the strongest sandbox; what it comes to is the same.

    Args:
        trial: As planned; it keeps its id.
    """
    values = json.loads(trial.scenario_json)
    for agent in values["agents"]:
        start = agent["start"]
        if start.get("process_of") is None and not start.get("attach"):
            agent["sandbox"] = "required"
        if start.get("python") is not None:
            start["door"] = "stdio"
    for participant in values.get("participants", []):
        participant["sandbox"] = "required"
    return replace(trial, scenario_json=json.dumps(values))


def _python_programs(trial: Trial) -> Iterator[Path]:
    for agent in trial.resolved.agents:
        if agent.start.python is not None:
            yield find_python_agent(agent.start.python, trial.directory)


# Of each program of a trial: its place in the scenario, its command line, and the folders that it asks for.
def _programs(trial: Trial) -> Iterator[tuple[str, list[str], tuple[str, ...]]]:
    scenario = trial.resolved
    for agent in scenario.agents:
        command = build_start_command(agent, trial.directory)
        if command is not None:
            yield agent.place, command, (*agent.may_read, *agent.may_write)
    for own in scenario.participants:
        yield own.place, resolve_command(own.start.command, trial.directory), (*own.may_read, *own.may_write)


def _reasons() -> str:
    return "; ".join(unavailable_reason(kind) for kind in ("bubblewrap", "landlock"))


def find_unsandboxed_rows(rows: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return the rows of runs whose agents were not all in a sandbox; those without a run have none."""
    return [row for row in rows if row["digest"] and not is_sandboxed(row["sandbox"])]
