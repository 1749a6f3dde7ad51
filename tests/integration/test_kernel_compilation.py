"""Kernels of bundled agents are compiled by a process of ours before an agent that may keep none needs them."""

import itertools
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.base.bundled import bundled_agents, bundled_scenarios
from gslcosim.methods.card import find_card_beside
from gslcosim.runtime import kernel_compilation
from gslcosim.runtime.kernel_compilation import compile_agent_kernels
from gslcosim.runtime.processes.sandbox.selection import unavailable_reason
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.method_scenario import build_method_scenario

DIRECTORY = bundled_scenarios()["tiny_room"].parent
# Runs in this process and prints how many kernels that can be cached were compiled.
COUNTING = """
import sys
from gslcosim.cli.main import main
from numba.core import event

compiled = []

class Counting(event.Listener):
    def on_start(self, event):
        compiled.extend([event.data["dispatcher"]] * hasattr(event.data["dispatcher"]._cache, "_impl"))

    def on_end(self, event):
        pass

event.register("numba:compile", Counting())
assert main(["up", "tiny_room", "--processes", "one", "--runs-dir", sys.argv[1]]) == 0
print(len(compiled))
"""
STARTED_APART = "agents[0].start={python: infotaxis, door: stdio}"


@pytest.mark.parametrize("name", sorted(bundled_agents()))
def test_each_bundled_agent_has_what_its_card_says_in_the_small_room(name):
    card = find_card_beside(bundled_agents()[name])
    assert card is not None
    scenario = build_method_scenario(name, card, DIRECTORY)
    assert scenario.agents[0].start.python == name
    assert len(scenario.agents) >= (card.robots if isinstance(card.robots, int) else card.robots[0])
    starts_m = [agent.vehicle.start_m for agent in scenario.agents]
    assert all(math.dist(*pair) > 0.9 for pair in itertools.combinations(starts_m, 2))


def compiled(*changes, is_one_process=False):
    """Return the names of agents whose kernels are compiled before a run."""
    scenario = load_scenario("tiny_room", overrides=changes).scenario
    names = []
    compile_agent_kernels(scenario, DIRECTORY, is_one_process=is_one_process, notify=names.append)
    return names


@pytest.mark.slow
def test_kernels_are_compiled_once_and_only_for_bundled_agents_in_sandboxes():
    """Agents without a sandbox, objects in this process, and programs of others compile for themselves."""
    if kernel_compilation.choose_sandbox(load_scenario("tiny_room").scenario.agents[0]) == "none":
        pytest.skip("there is no sandbox here")
    kernels = Path(os.environ["NUMBA_CACHE_DIR"])
    for mark in (kernels / "marks").glob("infotaxis.*"):
        mark.unlink()
    assert compiled(STARTED_APART, "agents[0].sandbox=none") == []
    assert compiled("agents[0].start={python: infotaxis}", is_one_process=True) == []
    assert compiled("agents[0].start={command: [cat], door: stdio}") == []
    assert compiled(STARTED_APART, is_one_process=True) == ["infotaxis"]
    assert any(path.name.startswith("objectives.") for path in kernels.rglob("*.nbc"))
    assert compiled(STARTED_APART) == []


@pytest.mark.slow
def test_a_run_compiles_nothing_that_was_compiled_ahead(tmp_path):
    compile_ahead = [sys.executable, "-m", "gslcosim", "cache", "compile", "tiny_room", "--json"]
    subprocess.run(compile_ahead, check=True)
    counting = [sys.executable, "-c", COUNTING, str(tmp_path)]
    assert subprocess.run(counting, capture_output=True, text=True, check=True).stdout.splitlines()[-1] == "0"


@pytest.mark.slow
@pytest.mark.parametrize("sandbox", ["bubblewrap", "landlock"])
def test_an_agent_in_a_sandbox_compiles_nothing_that_was_compiled_ahead(tmp_path, sandbox):
    """Kernels of the core and of extensions; numba would write the code that it compiles to the process's log."""
    if reason := unavailable_reason(sandbox):
        pytest.skip(reason)
    scenario = load_scenario("warehouse_racks").scenario
    assert scenario.agents[0].start.python == "gr_gsl"
    subprocess.run([sys.executable, "-m", "gslcosim", "cache", "compile", "warehouse_racks", "--json"], check=True)
    changes = (f"agents[0].sandbox={sandbox}", "referee.stop.time_limit_s=40", "recording.enabled=false")
    words = [word for change in changes for word in ("--set", change)]
    command = [sys.executable, "-m", "gslcosim", "up", "warehouse_racks", "--processes", "separate", *words]
    ended = subprocess.run(
        [*command, "--runs-dir", str(tmp_path)], env={**os.environ, "NUMBA_DUMP_LLVM": "1"}, stdout=subprocess.DEVNULL
    )
    assert ended.returncode == 1  # it searches until the time is up
    logs = {path.name: path.read_text() for path in tmp_path.glob("*/logs/*.log")}
    assert "agent_searcher.log" in logs
    assert [name for name, text in logs.items() if "LLVM DUMP" in text] == []
