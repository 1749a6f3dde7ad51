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
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

from gslcosim.base.command_lines import build_parent_death_prefix, build_python_command
from gslcosim.base.errors import GslCosimError
from gslcosim.base.kernel_cache import NUMBA_VARIABLE, PACKAGE_DIR
from gslcosim.methods.card import MethodCard, find_card_beside
from gslcosim.runtime.processes.sandbox.selection import choose_sandbox
from gslcosim.scenario import Scenario
from gslcosim.scenario.bundled import bundled_agents, bundled_scenarios
from gslcosim.scenario.loader import load_scenario, resolve_values
from gslcosim.scenario.serialization import plain_values

if sys.platform != "win32":
    import fcntl

COMPILE_TIMEOUT_S = 600.0
WARMUP_SCENARIO = "tiny_room"
# Long enough that methods have met gas, planned and moved; none succeeds before.
WARMUP_TIME_LIMIT_S = 60.0
_MARKERS_FOLDER = "agents"


def compile_agent_kernels(
    scenario: Scenario, directory: Path, *, is_one_process: bool, notify: Callable[[str], object] = lambda _: None
) -> None:
    """Compile the kernels of the bundled agents that a scenario starts in sandboxes, where that was not done before.

    What fails here is left to the agent's own process, which compiles for itself alone.

    Args:
        scenario: The scenario.
        directory: Its folder; relative paths start there.
        is_one_process: Whether Python agents are objects in this process, which keeps its kernels.
        notify: Is given the name of each agent before its kernels are compiled.
    """
    for name in _list_sandboxed_agents(scenario, directory, is_one_process=is_one_process):
        mark = _get_marker_path(name)
        if mark is None or mark.exists():
            continue
        notify(name)
        with contextlib.suppress(OSError, subprocess.SubprocessError):
            mark.parent.mkdir(parents=True, exist_ok=True)
            with _file_lock(mark.with_suffix(".lock")):
                if not mark.exists():
                    _compile_in_subprocess(name)
                    mark.touch()


def _compile_in_subprocess(name: str) -> None:
    subprocess.run(
        [*build_parent_death_prefix(), *build_python_command("-m", __name__, name)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        timeout=COMPILE_TIMEOUT_S,
        check=False,
    )


# Of several workers of a benchmark one compiles, and the others wait for it.
@contextlib.contextmanager
def _file_lock(path: Path) -> Generator[None]:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if sys.platform != "win32":
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


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


# Made again where numba compiles for something else; another processor makes it compile in the agent's own process.
def _get_marker_path(name: str) -> Path | None:
    if NUMBA_VARIABLE not in os.environ:
        return None
    facts = f"{PACKAGE_DIR}\0{sys.version}\0{platform.machine()}\0{platform.node()}"
    key = hashlib.blake2b(facts.encode(), digest_size=8).hexdigest()
    return Path(os.environ[NUMBA_VARIABLE]) / _MARKERS_FOLDER / f"{name}.{key}"


def run_agent_for_warmup(name: str) -> None:
    """Run a bundled agent in a small room of ours in this process, where it has kernels at all.

    Raises:
        GslCosimError: it cannot be run.
    """
    from gslcosim.runtime.agents.loader import load_python_agent

    program = bundled_agents()[name]
    load_python_agent(program)
    if "numba" not in sys.modules:
        return
    from gslcosim.base.scratch import ScratchFolder
    from gslcosim.environment.generation import prepare_environment
    from gslcosim.environment.store import load_environment
    from gslcosim.runtime.in_process import run_in_process
    from gslcosim.runtime.network import Network
    from gslcosim.runtime.run_dir import RunDir
    from gslcosim.runtime.setup import RunSetup

    directory = bundled_scenarios()[WARMUP_SCENARIO].parent
    scenario = build_warmup_scenario(name, find_card_beside(program), directory)
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


def build_warmup_scenario(name: str, card: MethodCard | None, directory: Path) -> Scenario:
    """Return a scenario in a small room in which a bundled agent has all that its card says it needs.

    Args:
        name: The agent's.
        card: Its card.
        directory: Where the scenario's relative paths start.

    Raises:
        GslCosimError: there is none.
    """
    values = plain_values(load_scenario(WARMUP_SCENARIO).scenario)
    needs = card.needs if card is not None else None
    first = values["agents"][0]
    first["start"] = {"python": name}
    first["knows"] = dict.fromkeys(needs.knows, True) if needs is not None else {}
    first["sensors"] = _build_sensors(tuple(needs.sensors) if needs is not None else ())
    robots = card.robots if card is not None else 1
    n_robots = robots if isinstance(robots, int) else robots[0]
    values["agents"] = [first, *(_build_robot(first, i) for i in range(1, n_robots))]
    if needs is not None and needs.radio:
        values["channels"] = [{"name": "radio"}]
    values["referee"]["success"] = {"within_m": 0.01, "of": "source"}
    values["referee"]["stop"] = {"time_limit_s": WARMUP_TIME_LIMIT_S}
    values["recording"] = {"enabled": False}
    return resolve_values(values, directory, source=f"the small room of {name}")


def _build_sensors(kinds: tuple[str, ...]) -> list[dict[str, Any]]:
    model = "pid" if "gas_ppm" in kinds else "tgs2600"
    camera = [{"model": "camera", "name": "eye", "period_s": 0.5}] if "camera" in kinds else []
    return [{"model": model, "name": "nose"}, {"model": "anemometer", "name": "wind"}, *camera]


# In a row across the room, apart from each other.
def _build_robot(first: dict[str, Any], i: int) -> dict[str, Any]:
    x_m, _, z_m = first["vehicle"]["start_m"]
    vehicle = {**first["vehicle"], "start_m": [x_m, float(i), z_m], "separation_m": 0.4}
    return {**first, "name": f"robot_{i + 1}", "start": {"process_of": first["name"]}, "vehicle": vehicle}


if __name__ == "__main__":
    with contextlib.suppress(GslCosimError):
        run_agent_for_warmup(sys.argv[1])
