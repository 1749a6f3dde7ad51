"""Compilation of the kernels of bundled agents, by a process of ours, before they are started in sandboxes.

An agent in a sandbox keeps nothing of what it compiles. So that bundled agents need not compile again in every run,
each of them is run once in a small room of ours, as an object in a process that runs code of the installation only.
"""

import contextlib
import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from gslcosim.base.bundled import bundled_agents, bundled_scenarios
from gslcosim.base.errors import GslCosimError
from gslcosim.base.files import hold_lock
from gslcosim.base.kernel_cache import EXTENSIONS_VARIABLE, NUMBA_VARIABLE, PACKAGE_DIR
from gslcosim.base.processes import build_parent_death_prefix, build_python_command
from gslcosim.methods.card import find_card_beside
from gslcosim.runtime.processes.sandbox.selection import choose_sandbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.method_scenario import METHOD_SCENARIO, build_method_scenario

COMPILE_TIMEOUT_S = 600.0
_MARKERS_FOLDER = "agents"


def compile_agent_kernels(
    scenario: Scenario, directory: Path, *, is_one_process: bool, notify: Callable[[str], object] = lambda _: None
) -> None:
    """Compile the kernels of the bundled agents that a scenario starts in sandboxes, unless that was done before.

    A failure here is ignored: the agent's own process then compiles its kernels, for itself alone.
    """
    for name in _list_sandboxed_agents(scenario, directory, is_one_process=is_one_process):
        mark = _get_marker_path(name)
        if mark is None or mark.exists():
            continue
        notify(name)
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            # One of several workers of a benchmark compiles, and the others wait for it.
            with hold_lock(mark.with_suffix(".lock")):
                if not mark.exists():
                    command = [*build_parent_death_prefix(), *build_python_command("-m", __name__, name)]
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


# A new path where numba compiles anew; after a change of processor, the agent's own process compiles instead.
def _get_marker_path(name: str) -> Path | None:
    if NUMBA_VARIABLE not in os.environ:
        return None
    extensions = os.environ.get(EXTENSIONS_VARIABLE, "")
    facts = f"{PACKAGE_DIR}\0{extensions}\0{sys.version}\0{platform.machine()}\0{platform.node()}"
    key = hashlib.blake2b(facts.encode(), digest_size=8).hexdigest()
    return Path(os.environ[NUMBA_VARIABLE]) / _MARKERS_FOLDER / f"{name}.{key}"


def run_agent_for_warmup(name: str) -> None:
    """Run a bundled agent in the small room of a bundled scenario, in this process, if the agent has kernels."""
    from gslcosim.runtime.agents.loader import load_python_agent

    program = bundled_agents()[name]
    load_python_agent(program)
    if "numba" not in sys.modules:
        return
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
    with contextlib.suppress(GslCosimError):
        run_agent_for_warmup(sys.argv[1])
