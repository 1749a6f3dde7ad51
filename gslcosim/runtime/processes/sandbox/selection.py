"""Selection of the sandbox that an agent or participant gets on this machine, and of what is hidden from it."""

import itertools
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from gslcosim.base.errors import UsageError
from gslcosim.base.kernel_cache import NUMBA_VARIABLE
from gslcosim.base.problems import Problem
from gslcosim.base.spawn import build_short_environment
from gslcosim.runtime.agents.loader import build_start_command, resolve_command
from gslcosim.runtime.processes.sandbox import confinement
from gslcosim.runtime.processes.sandbox.bubblewrap import find_bubblewrap_failure
from gslcosim.runtime.processes.sandbox.launcher_client import Confinement, is_launcher_possible
from gslcosim.runtime.processes.sandbox.policy import (
    SYSTEM_FOLDERS,
    SandboxPolicy,
    find_named_files,
    find_own_folders,
    list_code_folders,
    list_hidden_folders,
    list_private_system_paths,
    list_python_folders,
)
from gslcosim.runtime.processes.sandbox.program_files import (
    PrivatePlaces,
    is_truth_folder,
    list_run_places,
    select_program_files,
)
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import list_input_files
from gslcosim.scenario.models.participants import ParticipantProgramSpec
from gslcosim.scenario.models.scenario import AgentSpec

SandboxKind = Literal["bubblewrap", "landlock", "none"]
NONE_IN_THIS_PROCESS = "none: in this process"
NONE_STARTED_ELSEWHERE = "none: started elsewhere"


# Whose process is confined; `place` is its place in the scenario, for errors.
ConfinementSpec = AgentSpec | ParticipantProgramSpec


def unavailable_reason(kind: SandboxKind) -> str:
    """Return why a sandbox does not work on this machine, empty when it works."""
    if kind == "none":
        return ""
    if kind == "bubblewrap":
        return find_bubblewrap_failure()
    if not confinement.read_landlock_version():
        return "this kernel has no Landlock"
    return "" if confinement.can_filter() else "there is no filter of system calls for this kind of processor"


def find_strongest_sandbox() -> SandboxKind:
    """Return the strongest sandbox that works on this machine."""
    if not unavailable_reason("bubblewrap"):
        return "bubblewrap"
    return "none" if unavailable_reason("landlock") else "landlock"


def describe_sandboxes(scenario: Scenario, *, is_one_process: bool) -> Mapping[str, str]:
    """Return by agent and participant what its process is confined by, in the words of `result.json`."""
    starts = {agent.name: agent for agent in scenario.agents}
    of_agents = {
        agent.name: _describe_sandbox(starts[agent.process], is_one_process=is_one_process) for agent in scenario.agents
    }
    return {**of_agents, **{participant.name: _describe_started(participant) for participant in scenario.participants}}


def is_sandboxed(sandboxes: str) -> bool:
    """Return whether words of `describe_sandboxes`, or several of them joined by `; `, are all about sandboxes."""
    return bool(sandboxes) and not any(each.startswith("none") for each in sandboxes.split("; "))


def choose_sandbox(agent: ConfinementSpec) -> SandboxKind:
    """Return which sandbox the process of an agent or participant is started in."""
    _raise_problem(agent, _find_missing_sandbox(agent))
    start = agent.start.registered if isinstance(agent, AgentSpec) else None
    if start is not None and not start.is_confinable:
        return "none"
    return find_strongest_sandbox() if agent.sandbox in ("auto", "required") else agent.sandbox


def find_sandbox_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield the demands of a scenario on its processes that this machine, or the way they are started, cannot meet.

    Args:
        scenario: Scenario of the run; its `processes` determines whether Python agents are objects.
    """
    del directory
    is_one_process = scenario.processes == "one"
    for i, agent in enumerate(scenario.agents):
        if agent.process == agent.name:
            is_object = is_one_process and not agent.start.is_behind_gateway
            has_none = agent.start.attach or is_object
            problems = (_find_demands_without_process if has_none else _find_unmet_demands)(agent)
            yield from (replace(problem, where=f"agents[{i}].{problem.where}") for problem in problems)
    for i, participant in enumerate(scenario.participants):
        for problem in _find_unmet_demands(participant):
            yield replace(problem, where=f"participants[{i}].{problem.where}")


def _find_unmet_demands(agent: ConfinementSpec) -> Iterator[Problem]:
    found = (_find_missing_sandbox(agent), _find_missing_limits(agent), _find_unset_variable(agent, os.environ))
    return (problem for problem in found if problem is not None)


def _find_missing_sandbox(agent: ConfinementSpec) -> Problem | None:
    if agent.sandbox == "required" and find_strongest_sandbox() == "none":
        reasons = f"{unavailable_reason('bubblewrap')}; {unavailable_reason('landlock')}"
        remedy = f"{reasons[:1].upper()}{reasons[1:]}. Install bubblewrap, or take auto."
        return Problem(where="sandbox", expected="a sandbox on this machine", found="none", remedy=remedy)
    if agent.sandbox in ("auto", "required") or not (reason := unavailable_reason(agent.sandbox)):
        return None
    return Problem(
        where="sandbox",
        expected=f"{agent.sandbox} on this machine",
        found=f"one where it does not work: {reason}",
        remedy="Install it, or take auto for the strongest that works here; `gslcosim doctor` says which that is.",
    )


def _find_missing_limits(agent: ConfinementSpec) -> Problem | None:
    if not agent.limits.are_given or is_launcher_possible():
        return None
    return Problem(where="limits", expected="Linux for limits", found="another system", remedy="Leave them out.")


def _find_unset_variable(agent: ConfinementSpec, around: Mapping[str, str]) -> Problem | None:
    name = next((name for name, value in (agent.environment or {}).items() if value is None and name not in around), "")
    if not name:
        return None
    expected = "a variable that is set where gslcosim starts, since it has no value here"
    return Problem(where=f"environment.{name}", expected=expected, found="unset", remedy="Set it, or write its value.")


def _find_demands_without_process(agent: AgentSpec) -> Iterator[Problem]:
    where = "started elsewhere" if agent.start.attach else "an object in this process"
    remedy = (
        "Confine it where it is started, and leave this out."
        if agent.start.attach
        else "Leave out --in-process, or start it with door: stdio."
    )
    wanted = {
        "sandbox": {"required": "a sandbox", "auto": "", "none": ""}.get(agent.sandbox, agent.sandbox),
        "limits": "bounds" if agent.limits.are_given else "",
        "environment": "variables" if agent.environment else "",
    }
    for key, value in wanted.items():
        if value:
            expected = f"an agent with a process that is started here for {value}"
            yield Problem(where=key, expected=expected, found=where, remedy=remedy)


def _raise_problem(agent: ConfinementSpec, problem: Problem | None) -> None:
    if problem is not None:
        raise UsageError(f"{agent.place}.{problem}")


def _describe_sandbox(agent: AgentSpec, *, is_one_process: bool) -> str:
    is_object = is_one_process and not agent.start.is_behind_gateway
    if agent.start.attach or is_object:
        _raise_problem(agent, next(_find_demands_without_process(agent), None))
        return NONE_STARTED_ELSEWHERE if agent.start.attach else NONE_IN_THIS_PROCESS
    return _describe_started(agent)


def _describe_started(agent: ConfinementSpec) -> str:
    kind = choose_sandbox(agent)
    _raise_problem(agent, _find_missing_limits(agent))
    gaps = list_open_gaps(kind)
    name = f"landlock {confinement.read_landlock_version()}" if kind == "landlock" else kind
    return f"{name} (open: {', '.join(gaps)})" if gaps else name


def list_open_gaps(kind: SandboxKind) -> list[str]:
    """Return in words what a sandbox leaves open on this machine that it closes on others."""
    if kind == "landlock":
        return confinement.list_missing_protections(confinement.read_landlock_version())
    if kind == "bubblewrap" and not confinement.can_filter():
        return ["keys of the user, perf, watching of files and io_uring are not refused on this kind of processor"]
    return []


def build_environment_variables(
    agent: ConfinementSpec, command: Sequence[str], surroundings: Mapping[str, str] | None = None
) -> dict[str, str]:
    """Return the variables with which the process of an agent or participant starts; those of the run come on top.

    Args:
        surroundings: From which variables are taken; absent: this process's own.
    """
    around = os.environ if surroundings is None else surroundings
    variables = build_short_environment(command, around)
    _raise_problem(agent, _find_unset_variable(agent, around))
    for name, value in (agent.environment or {}).items():
        variables[name] = around[name] if value is None else value
    return variables


def build_confinement(
    agent: ConfinementSpec,
    command: Sequence[str],
    setup: RunSetup,
    *,
    directory: Path,
    private_dir: Path,
    address: str = "",
) -> Confinement:
    """Return how the process of an agent or participant is confined, which reaches the run at an address, if at one.

    Args:
        address: `unix:PATH` or `tcp:HOST:PORT`.
    """
    kind = choose_sandbox(agent)
    door, _, place = address.partition(":")
    environment = build_environment_variables(agent, command)
    if kind == "none":
        return Confinement(limits=agent.limits, environment=environment)
    scratch = private_dir / f"scratch-{agent.name}"
    scratch.mkdir(mode=0o700)
    named = find_named_files(command, directory)
    own = list(named)
    granted = [(directory / Path(path).expanduser()).absolute() for path in agent.may_read]
    sources = [*setup.sources, *list_input_files(setup.scenario, directory)]
    _check_program(agent, [folder for folder in own if folder not in granted], setup, sources)
    of_python = list_python_folders()
    private = [*list_hidden_folders(), *_list_run_folders(setup), *sources]
    programs = [
        select_program_files(folder, named[folder], _without_places_around(private, folder), place=agent.place)
        for folder in own
        if not any(map(folder.is_relative_to, (*granted, *of_python)))
    ]
    of_programs = [path for each in programs for path in each.reads]
    within_granted = [
        path
        for folder in granted
        if folder not in of_python
        for path in list_run_places(folder, _without_places_around(private, folder), place=agent.place)
    ]
    needed = (*of_programs, *granted, *of_python)
    of_system = [path for path in list_private_system_paths() if not any(map(path.is_relative_to, needed))]
    hidden = [*of_system, *private, *within_granted, *(path.resolve() for path in within_granted)]
    hidden = [path for path in hidden if path not in (*of_programs, *granted)]
    is_python = Path(command[0]).name.startswith("python") and NUMBA_VARIABLE in os.environ
    kernels = [Path(os.environ[NUMBA_VARIABLE])] if is_python else []
    writes = [(directory / Path(path).expanduser()).absolute() for path in agent.may_write]
    _check_writes(agent, writes, setup, directory)
    readable = [*of_programs, *granted, *of_python, *map(Path, SYSTEM_FOLDERS)]
    hidden += [path.resolve() for path in hidden]
    cell = SandboxPolicy(
        directory=directory.absolute(),
        reads=_keep_existing([*readable, *kernels]),
        hidden=_keep_existing([*hidden, *_under_other_names(hidden, readable)]),
        writes=_keep_existing(writes),
        sockets=(Path(place),) if door == "unix" else (),
        tcp_port=int(place.rpartition(":")[2]) if door == "tcp" else None,
        scratch=scratch,
    )
    unseen = tuple(path for each in programs for path in each.unseen)
    return Confinement(kind=kind, policy=cell, unseen=unseen, limits=agent.limits, environment=environment)


# Leaves out private places around a folder, such as the cache around a program: the folder itself is wanted.
def _without_places_around(private: Sequence[Path], folder: Path) -> PrivatePlaces:
    return PrivatePlaces([path for path in private if not folder.resolve().is_relative_to(path.resolve())])


# A program sees all files in its folder.
def _check_program(agent: ConfinementSpec, own: Sequence[Path], setup: RunSetup, sources: Sequence[Path]) -> None:
    runs, temporary = setup.run_dir.path.absolute().parent, Path(tempfile.gettempdir())
    for folder in own:
        place = folder.resolve()
        if is_truth_folder(folder) or any(place.is_relative_to(each.resolve()) for each in sources):
            raise UsageError(
                f"{agent.place}.start: expected a command that names no file of a run, of results or of an "
                f"environment, which an agent in a sandbox does not see, was one in {folder}. Move the program "
                "elsewhere, or name the folder in may_read."
            )
        if place == runs.resolve() or temporary.resolve().is_relative_to(place):
            what = "runs are made" if place == runs.resolve() else "other processes keep their temporary files"
            raise UsageError(
                f"{agent.place}.start: expected a program in a folder of its own, which the agent in a sandbox sees "
                f"with all that comes to lie there, was one in {folder}, where {what}. Move the program, or name "
                "the folder in may_read."
            )


# Where code or runs are nothing may be written, nor around it; agents may share a folder within that of their programs.
def _check_writes(agent: ConfinementSpec, writes: Sequence[Path], setup: RunSetup, directory: Path) -> None:
    closed = [*list_code_folders(), *list_hidden_folders(), *_list_run_folders(setup)]
    programs = _list_other_programs(agent, setup, directory)
    for given, folder in zip(agent.may_write, writes, strict=True):
        for place in dict.fromkeys((folder, folder.resolve())):
            within = (each for each in (*closed, *programs) if each.is_relative_to(place))
            around = (each for each in closed if place.is_relative_to(each))
            if (other := next(itertools.chain(within, around), None)) is not None:
                raise UsageError(
                    f"{agent.place}.may_write: expected a folder from which no other process reads code and which "
                    f"holds nothing of runs, was {given!r}, which is part of {other} or has it within. Name a folder "
                    "of its own."
                )


def _list_other_programs(agent: ConfinementSpec, setup: RunSetup, directory: Path) -> list[Path]:
    scenario = setup.scenario
    commands = [build_start_command(each, directory) for each in scenario.agents if each.name != agent.name]
    commands += [
        resolve_command(each.start.words, directory) for each in scenario.participants if each.name != agent.name
    ]
    own = [folder for command in commands if command is not None for folder in find_own_folders(command, directory)]
    return [*own, *(folder.resolve() for folder in own)]


def _list_run_folders(setup: RunSetup) -> list[Path]:
    run = setup.run_dir.path.absolute()
    return [run.parent, run, setup.environment_dir]


# Where a folder is read by way of a link, what is hidden in it has that name too.
def _under_other_names(hidden: Sequence[Path], readable: Sequence[Path]) -> list[Path]:
    return [
        folder / path.relative_to(folder.resolve())
        for folder in readable
        if folder.resolve() != folder
        for path in hidden
        if path.is_relative_to(folder.resolve())
    ]


def _keep_existing(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(path for path in dict.fromkeys(paths) if path.exists())
