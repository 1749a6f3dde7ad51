"""A search as an environment of Gymnasium is the run that `gslcosim up` makes of the same commands."""

import json
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gslcosim_training
from gslcosim.base.errors import ScenarioError, UsageError
from gslcosim.cli.main import main
from gslcosim.contract import codec
from gslcosim_training import SEARCH
from gslcosim_training.search_env import SearchEnv

# Sends what a list of commands holds, by the tick of the observation.
SAYER = """
import json, pathlib
from gslcosim.agent_kit import Agent, Command, run
from gslcosim.contract import codec

SAID = json.loads(pathlib.Path(__file__).with_name("said.json").read_text())


class Sayer(Agent):
    def __init__(self, briefing):
        pass

    def decide(self, observation):
        return codec.decode_json(Command, SAID[str(observation.tick)].encode())


if __name__ == "__main__":
    run(Sayer)
"""


LIMIT = "referee.stop.time_limit_s=5"


def flown_at_random(env, *, seed):
    """Fly to the end; return rewards and the last info."""
    env.reset(seed=seed)
    env.action_space.seed(seed)
    rewards, is_over = [], False
    while not is_over:
        _, reward, is_terminated, is_truncated, info = env.step(env.action_space.sample())
        rewards.append(reward)
        is_over = is_terminated or is_truncated
    return rewards, info


@pytest.mark.slow
@pytest.mark.tour
def test_gymnasiums_checker_passes_and_the_digest_is_that_of_up(tmp_path, monkeypatch, capsys):
    env = gymnasium.make(SEARCH, scenario="tiny_room").unwrapped
    check_env(env)
    said = {}
    answered = gslcosim_training.stepped_run.SteppedRun.command

    def noted(flight, agent, command):
        said[command.tick] = codec.encode_json(command).decode()
        answered(flight, agent, command)

    monkeypatch.setattr(gslcosim_training.stepped_run.SteppedRun, "command", noted)
    _, info = flown_at_random(env, seed=5)
    env.close()
    (tmp_path / "said.json").write_text(json.dumps(said))
    (tmp_path / "sayer.py").write_text(SAYER)
    words = ["up", "tiny_room", "--seed", "5", "--json", "--runs-dir", str(tmp_path), "--in-process"]
    main([*words, "--set", f"agents[0].start={{python: {tmp_path / 'sayer.py'}}}"])
    result = json.loads(capsys.readouterr().out)
    assert info["digest"] == result["digest"]
    assert info["outcome"] == result["end_reason"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        {"action": "heading", "render_mode": "rgb_array"},
        {"action": "velocity", "reward": "sparse", "overrides": ("agents[0].mode=lockstep", LIMIT)},
        {"action": "waypoint_3d", "overrides": ("agents[0].mode={latency: 3}", LIMIT)},
    ],
)  # fmt: skip
def test_every_action_and_mode_passes_the_checker_and_repeats_itself(settings):
    env = gymnasium.make(SEARCH, scenario="tiny_room", **settings).unwrapped
    check_env(env)
    first, second = flown_at_random(env, seed=3), flown_at_random(env, seed=3)
    assert first == second
    assert "digest" in first[1]
    assert flown_at_random(env, seed=4) != first
    env.close()


def test_a_search_that_finds_the_source_terminates():
    env = SearchEnv("tiny_room", reward="sparse", overrides=("agents[0].vehicle.start_m=[2.9, 2, 0.2]",), hold_s=0.0)
    env.reset(seed=1)
    is_over = False
    while not is_over:
        _, reward, is_over, _, info = env.step(np.array([-1.0, 0.0], np.float32))
    assert (reward, info["outcome"], info["success"]) == (1.0, "success", True)
    env.close()


def test_wrong_arguments_are_reported():
    with pytest.raises(UsageError, match="scenario: expected one agent, was 3 in swarm_tiny"):
        SearchEnv("swarm_tiny")
    with pytest.raises(UsageError, match="action: expected one of waypoint"):
        SearchEnv("tiny_room", action="jump")
    with pytest.raises(UsageError, match="render_mode: expected rgb_array or None, was 'human'"):
        SearchEnv("tiny_room", render_mode="human")
    with pytest.raises(ScenarioError, match="hold"):
        SearchEnv("tiny_room", overrides=("agents[0].vehicle.hold_s=soon",))
    env = SearchEnv("tiny_room")
    with pytest.raises(UsageError, match=r"No search is active\. Call reset before step\."):
        env.step(np.zeros(2, np.float32))
    with pytest.raises(UsageError, match="reset: options: expected none, was wind"):
        env.reset(options={"wind": 1})


def test_the_core_does_not_need_gymnasium():
    loaded = f"import sys, {', '.join(('gslcosim', 'gslcosim.cli.main', 'gslcosim.agent_kit'))}"
    import subprocess

    code = f"{loaded}; sys.exit('gymnasium' in sys.modules or 'pettingzoo' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=Path.cwd(), check=False).returncode == 0
