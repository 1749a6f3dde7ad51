"""Kernels of bundled agents are compiled by a process of ours before an agent that may keep none needs them."""

import os
from pathlib import Path

import pytest

from gslcosim.base.bundled import bundled_agents, bundled_scenarios
from gslcosim.methods.card import find_card_beside
from gslcosim.runtime.agents import kernel_warmup
from gslcosim.runtime.agents.kernel_warmup import compile_agent_kernels
from gslcosim.scenario.loader import load_scenario
from gslcosim.scenario.method_scenario import build_method_scenario

DIRECTORY = bundled_scenarios()["tiny_room"].parent
STARTED_APART = "agents[0].start={python: infotaxis, door: stdio}"


@pytest.mark.parametrize("name", sorted(bundled_agents()))
def test_each_bundled_agent_has_what_its_card_says_in_the_small_room(name):
    card = find_card_beside(bundled_agents()[name])
    assert card is not None
    scenario = build_method_scenario(name, card, DIRECTORY)
    assert scenario.agents[0].start.python == name
    assert len(scenario.agents) >= (card.robots if isinstance(card.robots, int) else card.robots[0])


def compiled(*changes, is_one_process=False):
    """Return the names of agents whose kernels are compiled before a run."""
    scenario = load_scenario("tiny_room", overrides=changes).scenario
    names = []
    compile_agent_kernels(scenario, DIRECTORY, is_one_process=is_one_process, notify=names.append)
    return names


@pytest.mark.slow
def test_kernels_are_compiled_once_and_only_for_bundled_agents_in_sandboxes():
    """Agents without a sandbox, objects in this process, and programs of others compile for themselves."""
    if kernel_warmup.choose_sandbox(load_scenario("tiny_room").scenario.agents[0]) == "none":
        pytest.skip("there is no sandbox here")
    kernels = Path(os.environ["NUMBA_CACHE_DIR"])
    for mark in (kernels / "agents").glob("infotaxis.*"):
        mark.unlink()
    assert compiled(STARTED_APART, "agents[0].sandbox=none") == []
    assert compiled("agents[0].start={python: infotaxis}", is_one_process=True) == []
    assert compiled("agents[0].start={command: [cat], door: stdio}") == []
    assert compiled(STARTED_APART, is_one_process=True) == ["infotaxis"]
    assert any(path.name.startswith("objectives.") for path in kernels.rglob("*.nbc"))
    assert compiled(STARTED_APART) == []
