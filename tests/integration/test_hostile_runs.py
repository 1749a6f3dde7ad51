"""A hostile agent in a whole run: the run stays valid, faults are its own, notices say what was expected."""

import dataclasses
import sys
from pathlib import Path

import pytest

from gslcosim.runtime.run import run_scenario
from gslcosim.scenario import load_scenario
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import plain_values
from gslcosim_services.world.path_follower import OVERTURNED_NOTICE

HERE = Path(__file__).parent
AROUND_A_WALL = HERE.parent / "end_to_end" / "around_a_wall.yaml"


def hostile_run(tmp_path, *, model, avoidance, ends_on_collision):
    """Fly the hostile agent beside a wall and another agent that goes on with its own run."""
    loaded = load_scenario(AROUND_A_WALL)
    values = plain_values(loaded.scenario)
    hostile, other = values["agents"]
    hostile.update(name="hostile", start={"python": "agents/hostile.py"}, mode="lockstep")
    hostile["vehicle"].update(model=model, avoidance=avoidance, separation_m=0.0)
    other.update(start={"python": str(AROUND_A_WALL.parent / "agents" / "crossing.py")})
    values["recording"]["enabled"] = False
    values["referee"]["stop"].update(time_limit_s=16.0, on_collision=ends_on_collision)
    scenario = Scenario.model_validate(values)
    result = run_scenario(
        dataclasses.replace(loaded, scenario=scenario, directory=HERE), runs_dir=tmp_path, processes="one"
    )
    [agent_type] = [
        value for value in vars(sys.modules["gslcosim_agent_agents_hostile"]).values()
        if isinstance(value, type) and value.__name__ == "Hostile"
    ]  # fmt: skip
    return result.result, agent_type.notices


@pytest.mark.slow
@pytest.mark.parametrize("ends_on_collision", [True, False])
@pytest.mark.parametrize(("model", "avoidance"), [("iris", "3d"), ("crazyflie", "none")])
def test_a_hostile_agent_harms_only_itself(tmp_path, model, avoidance, ends_on_collision):
    result, _ = hostile_run(tmp_path, model=model, avoidance=avoidance, ends_on_collision=ends_on_collision)
    assert result["valid"], result
    assert result["end_reason"] == "time_limit"
    assert {fault["participant"] for fault in result["faults"]} == {"agent hostile"}
    hostile, other = result["agents"]
    assert hostile["outcome"] == ("collision" if ends_on_collision else "agent_failed")
    # The other one crosses the room once at least.
    assert (other["outcome"], other["path_length_m"] > 5.0) == ("time_limit", True)


@pytest.mark.slow
def test_everything_wrong_is_answered_in_words(tmp_path):
    result, notices = hostile_run(tmp_path, model="iris", avoidance="3d", ends_on_collision=False)
    faults = " ".join(fault["text"] for fault in result["faults"])
    for text in (
        "position_world_m.0: input should be a finite number, was nan",
        "velocity_world_m_s.1: input should be a finite number, was nan",
        "was 'teleport'",
        "a mission command needs waypoints",
        "expected an answer to the observation of tick",
    ):
        assert text in faults
    assert notices["kilometre"] == "waypoint: expected x within 0 to 8 m, was 1000 m."
    assert notices["under the floor"] == "waypoints[0]: expected z within 0.38 to 2.62 m, was -1 m."
    assert "goes to" in notices["in the wall"]
    assert notices["too fast"] == "velocity: expected at most 1 m/s, was 300 m/s."
    assert notices["too strong"].startswith("attitude.thrust_n: expected at most")
    assert notices["take off twice"] == "take_off: expected a vehicle that has landed, was in the air."
    assert notices["a thousand places"].endswith("more places are moved.")
    assert notices["up again"] == OVERTURNED_NOTICE
