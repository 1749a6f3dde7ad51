"""Compilation of kernels ahead of runs, into the cache: of environments, services and bundled agents.

A run compiles by itself what the cache lacks, except for bundled agents in sandboxes, which keep nothing of what they
compile: each of them flies once in a small room of ours, as an object in a process that runs code of the installation
only.
"""

import contextlib
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from gslcosim.base.bundled import bundled_agents, bundled_scenarios
from gslcosim.base.errors import GslCosimError
from gslcosim.base.files import hold_lock
from gslcosim.base.kernel_archives import has_all_archives
from gslcosim.base.kernel_cache import NUMBA_VARIABLE, get_extensions_hash, get_mark_path
from gslcosim.base.processes import build_parent_death_prefix, build_python_command
from gslcosim.methods.card import find_card_beside
from gslcosim.runtime.processes.sandbox.selection import choose_sandbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.method_scenario import METHOD_SCENARIO, build_method_scenario

COMPILE_TIMEOUT_S = 600.0
_LOOK_EVERY_S = 0.2
_log = logging.getLogger(__name__)
MAX_PROCESSES = 4
# With other models or vehicles it is a few more or less.
N_KERNELS_OF_RUN = 140
N_KERNELS = 222
_AGENTS_OF_A_JOB = 8


class KernelFolder:
    """Number of kernels in numba's folder, now and when this object was made.

    Args:
        folder: By default that of this process, which all processes of a run use.
        n_needed: About how many there will be.
    """

    def __init__(self, folder: Path | None = None, n_needed: int = N_KERNELS_OF_RUN) -> None:
        self.path = folder or Path(os.environ.get(NUMBA_VARIABLE, os.devnull))
        self._n_needed = n_needed
        self._before = self._count()

    def has_new(self) -> bool:
        """Return whether kernels were added since."""
        return self._count() > self._before

    def estimate_fraction(self) -> float:
        """Return about which fraction of the kernels is there."""
        return min(self._count() / self._n_needed, 0.99)

    def _count(self) -> int:
        return sum(1 for _ in self.path.glob("*/*.nbc"))


@dataclass(frozen=True, kw_only=True)
class _Job:
    # Work of one process: kernels of a scenario's environment, of its services, or of agents.
    kind: str
    names: tuple[str, ...]

    @property
    def command(self) -> list[str]:
        return build_python_command("-m", __name__, self.kind, *self.names)


def compile_kernels(scenarios: Sequence[str] = (), report: Callable[[float], object] = lambda _: None) -> None:
    """Compile kernels in a few processes at once, and keep them in the cache.

    Args:
        scenarios: Files or names of scenarios, for what their runs need; none: for all bundled scenarios and agents.
        report: Gets the fraction done.

    Raises:
        ScenarioError: a scenario is wrong.
        subprocess.CalledProcessError: a process could not do it; its standard error has been shown.
    """
    for name in scenarios:
        load_scenario(name)
    folder, waiting = KernelFolder(n_needed=N_KERNELS_OF_RUN if scenarios else N_KERNELS), _plan(scenarios)
    running: list[tuple[_Job, subprocess.Popen[bytes]]] = []
    try:
        while waiting or running:
            while waiting and len(running) < min(MAX_PROCESSES, os.cpu_count() or 1):
                job = waiting.pop(0)
                command = [*build_parent_death_prefix(), *job.command]
                running.append((job, subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)))
            report(folder.estimate_fraction())
            with contextlib.suppress(subprocess.TimeoutExpired):
                running[0][1].wait(_LOOK_EVERY_S)
            for job, process in list(running):
                if process.poll() is not None:
                    running.remove((job, process))
                    if process.returncode != 0:
                        raise subprocess.CalledProcessError(process.returncode, job.command)
        report(1.0)
    finally:
        for _, process in running:
            process.kill()
            process.wait()


def _plan(scenarios: Sequence[str]) -> list[_Job]:
    if scenarios:
        return [
            _Job(kind=kind, names=(name,)) for name in scenarios for kind in ("environment", "services", "agents-of")
        ]
    agents = tuple(bundled_agents())
    parts = [agents[first : first + _AGENTS_OF_A_JOB] for first in range(0, len(agents), _AGENTS_OF_A_JOB)]
    return [
        _Job(kind="services", names=tuple(bundled_scenarios())),
        _Job(kind="environment", names=()),
        *(_Job(kind="agents", names=names) for names in parts),
    ]


def compile_agent_kernels(
    scenario: Scenario, directory: Path, *, is_one_process: bool, notify: Callable[[str], object] = lambda _: None
) -> None:
    """Compile the kernels of the bundled agents that a scenario starts in sandboxes, unless that was done before.

    A failure here is ignored: the agent's own process then compiles its kernels, for itself alone.
    """
    for name in _list_sandboxed_agents(scenario, directory, is_one_process=is_one_process):
        mark = _get_mark_path(name)
        if mark is None or mark.exists() or has_all_archives():
            continue
        notify(name)
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            # One of several workers of a benchmark compiles, and the others wait for it.
            with hold_lock(mark.with_suffix(".lock")):
                if not mark.exists():
                    command = [*build_parent_death_prefix(), *_Job(kind="agents", names=(name,)).command]
                    nothing = subprocess.DEVNULL
                    subprocess.run(
                        command, stdin=nothing, stdout=nothing, stderr=nothing, timeout=COMPILE_TIMEOUT_S, check=False
                    )
                    mark.touch()


def _list_sandboxed_agents(scenario: Scenario, directory: Path, *, is_one_process: bool) -> list[str]:
    names = [
        agent.start.python
        for agent in scenario.agents
        if agent.start.python is not None
        and (agent.start.is_behind_gateway or not is_one_process)
        and not (directory / agent.start.python).is_file()
        and choose_sandbox(agent) != "none"
    ]
    bundled = bundled_agents() if names else {}
    return [name for name in dict.fromkeys(names) if name in bundled]


# A new path where numba compiles anew.
def _get_mark_path(name: str) -> Path | None:
    return get_mark_path(name, get_extensions_hash()) if NUMBA_VARIABLE in os.environ else None


def run_job(kind: str, names: Sequence[str]) -> None:
    """Compile in this process what one job of `compile_kernels` names."""
    if kind == "environment":
        _compile_environments(names)
        return
    for name in names:
        if kind == "services":
            _compile_services(name)
        elif kind == "agents":
            try:
                _compile_agent(name)
            except GslCosimError as error:
                _log.warning("%s: %s", name, error)  # as one whose packages are not installed
        else:
            bundled = bundled_agents()
            starts = [agent.start.python for agent in load_scenario(name).scenario.agents]
            run_job("agents", [start for start in dict.fromkeys(starts) if start in bundled])


def _compile_environments(scenarios: Sequence[str]) -> None:
    from gslcosim.environment.generation.cache import SHORT_SOLVES, prepare_environment

    for source, changes in [(name, ()) for name in scenarios] or [
        (METHOD_SCENARIO, changes) for changes in SHORT_SOLVES
    ]:
        loaded = load_scenario(source, overrides=changes)
        prepare_environment(loaded.scenario, scenario_dir=loaded.directory)


def _compile_services(source: str) -> None:
    from gslcosim.base.files import ScratchFolder
    from gslcosim.environment.geometry_source import build_unsolved_environment, find_folder
    from gslcosim.environment.store import load_environment, save_environment
    from gslcosim.runtime.distributed.service_main import import_shared_modules
    from gslcosim.runtime.run_dir import RunDir
    from gslcosim.runtime.services import build_core, list_services
    from gslcosim.runtime.setup import RunSetup

    import_shared_modules()
    loaded = load_scenario(source)
    scenario, directory = loaded.scenario, loaded.directory
    with ScratchFolder("kernels") as scratch:
        if scenario.environment.path is not None:
            environment = load_environment(find_folder(scenario.environment, directory))
        else:
            # As a run loads it: other kernels belong to arrays that can be written.
            unsolved, room = build_unsolved_environment(scenario, scenario_dir=directory), scratch.path / "room"
            save_environment(unsolved, room)
            environment = replace(load_environment(room), later_rooms=unsolved.later_rooms)
        setup = RunSetup(
            run_dir=RunDir(scratch.path), scenario=scenario, environment_dir=directory, environment=environment
        )
        services = [kind for kind in list_services(scenario) if kind.is_warmed_up]
        for kind in sorted(services, key=lambda kind: not kind.has_most_kernels):
            build_core(kind.name, setup)


# Flies in the small room, in this process, if the agent has kernels; leaves a mark in either case.
def _compile_agent(name: str) -> None:
    from gslcosim.runtime.agents.loader import load_python_agent

    program = bundled_agents()[name]
    load_python_agent(program)
    if "numba" in sys.modules:
        _fly_in_small_room(name, program)
    if (mark := _get_mark_path(name)) is not None:
        with contextlib.suppress(OSError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            mark.touch()


def _fly_in_small_room(name: str, program: Path) -> None:
    from gslcosim.base.files import ScratchFolder
    from gslcosim.environment.generation.cache import prepare_environment
    from gslcosim.environment.store import load_environment
    from gslcosim.runtime.in_process import run_in_process
    from gslcosim.runtime.network import Network
    from gslcosim.runtime.run_dir import RunDir
    from gslcosim.runtime.setup import RunSetup

    directory = bundled_scenarios()[METHOD_SCENARIO].parent
    scenario = build_method_scenario(name, find_card_beside(program), directory)
    environment_dir = prepare_environment(scenario, scenario_dir=directory)
    with ScratchFolder("kernels") as scratch:
        (scratch.path / "logs").mkdir()
        setup = RunSetup(
            run_dir=RunDir(scratch.path),
            scenario=scenario,
            environment_dir=environment_dir,
            environment=load_environment(environment_dir),
        )
        run_in_process(setup, directory, Network(), lambda _: None)


if __name__ == "__main__":
    try:
        run_job(sys.argv[1], sys.argv[2:])
    except GslCosimError as error:
        sys.exit(str(error))
