"""Adapters of docs/examples/adapters: a world as OTTO's policies want it, and flies of olfactory-navigation."""

import importlib.util
import math
import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim.contract.messages import Bounds
from gslcosim.runtime.agents.loader import load_python_agent
from gslcosim_search.information.pomdp import OffsetGrid, PlumeTable, offsets_m
from gslcosim_search.motion.legs import LegSpace

ADAPTERS = Path(__file__).parents[4] / "docs" / "examples" / "adapters"
OttoPolicy = load_python_agent(ADAPTERS / "otto" / "agent.py")
Fly = load_python_agent(ADAPTERS / "olfactory_navigation" / "agent.py")
otto, flies = (sys.modules[agent.__module__] for agent in (OttoPolicy, Fly))
TABLE = PlumeTable.load(Path(str(resources.files("gslcosim_agents"))) / "qmdp" / "plumes.npz")
PID = (("pid", "nose"), ("anemometer", "vane"))
ROOM = LegSpace.within(Bounds(min_m=(0.0, 0.0, 0.0), max_m=(10.0, 6.0, 4.0)), 0.5)
# Written to OTTO's interface, with nothing of OTTO: towards the least mean entropy.
POLICIES = """
import numpy as np

class Infotaxis:
    def __init__(self, env, policy):
        self.env = env

    def choose_action(self):
        return int(np.argmin([self.entropy_after(action) for action in range(self.env.Nactions)]))

    def entropy_after(self, action):
        cell, is_possible = self.env._move(action, self.env.agent)
        if not is_possible:
            return np.inf
        left = self.env.p_source.copy()
        found = left[tuple(cell)]
        left[tuple(cell)] = 0.0
        joint = left / (1.0 - found) * self.env._extract_N_from_2N(input=self.env.p_Poisson, origin=cell)
        each = joint.sum(axis=(1, 2))
        return (1.0 - found) * sum(p * self.env._entropy(b / p) for p, b in zip(each, joint) if p > 0.0)
"""


@pytest.fixture
def policies(tmp_path, monkeypatch):
    """A folder with a module of policies, as a checkout of OTTO would be; nothing of it stays."""
    (tmp_path / "policies_for_otto.py").write_text(POLICIES)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield {"path": str(tmp_path), "module": "policies_for_otto", "class_name": "Infotaxis", "policy": 0}
    sys.modules.pop("policies_for_otto", None)


def world(start_m=(4.0, 3.0), step_m=1.0):
    return otto.RoomAsGrid(ROOM, start_m, step_m, 3)


def seen(ppm=0.0, position_m=(4.0, 3.0, 2.0), tick=40, **more):
    return observation(tick=tick, position_m=position_m, readings={"nose": ppm, "vane": (0.5, math.pi)}, **more)


def test_moves_step_along_axes_and_not_through_walls_nor_to_refused_cells():
    env = world()
    i, j = env.agent
    assert [env._move(a, env.agent)[0] for a in range(4)] == [[i - 1, j], [i + 1, j], [i, j - 1], [i, j + 1]]
    at_wall = [i, j + 2]
    assert env._move(3, at_wall) == (at_wall, False)
    env.refuse([i + 1, j])
    assert env._move(1, env.agent) == ([i, j], False)


def test_what_a_policy_reads_off_is_the_chance_of_each_number_of_hits_from_each_source_cell():
    env = world()
    env.learn(0, TABLE, 0.4, 1.0)
    cell = [env.agent[0] + 2, env.agent[1] - 1]
    chances = env._extract_N_from_2N(input=env.p_Poisson, origin=cell)
    offsets = offsets_m(env.grid.centres_m(), env.grid.centre_m(cell), 0.4)
    expected = np.array([TABLE.likelihood(k, offsets).reshape(env.N, env.N) for k in range(3)])
    expected[:, cell[0], cell[1]] = 0.0
    assert chances == pytest.approx(expected)


def test_a_policy_for_otto_finds_a_source_with_gas_as_the_table_has_it(policies):
    rng, source_m = np.random.default_rng(4), np.array([[2.0, 3.0]])
    agent_briefing = briefing(sensors=PID, size_m=(10.0, 6.0, 4.0), parameters={**policies, "power": 1.0})
    agent, position_m = OttoPolicy(agent_briefing), (8.0, 4.0, 2.0)
    for tick in range(40, 40 * 200, 40):
        chances = [TABLE.likelihood(k, offsets_m(source_m, position_m[:2], 0.0))[0] for k in range(3)]
        ppm = float(flies.ppm_of_levels(TABLE)[rng.choice(3, p=np.array(chances) / sum(chances))])
        command = agent.decide(seen(ppm, position_m, tick))
        if command.kind == "waypoint":
            assert math.dist(command.position_world_m[:2], position_m[:2]) < 1.01
            position_m = command.position_world_m
        if math.dist(position_m[:2], source_m[0]) < 1.0:
            return
    pytest.fail("no source after 200 steps")


def test_a_refused_step_is_not_taken_again_and_equal_seeds_step_alike(policies):
    agent_briefing = briefing(sensors=PID, size_m=(10.0, 6.0, 4.0), parameters=policies)
    first, same = OttoPolicy(agent_briefing), OttoPolicy(agent_briefing)
    one = first.decide(seen())
    assert one == same.decide(seen())
    again = first.decide(seen(tick=80, notice="in an obstacle"))
    assert again.position_world_m != one.position_world_m


def test_without_otto_it_says_where_it_looks_for_it():
    agent = OttoPolicy(briefing(sensors=PID, parameters={"path": "/nowhere"}))
    with pytest.raises(SystemExit, match=r"parameters\.path: expected the folder of a checkout of OTTO"):
        agent.decide(seen())


def test_a_movie_shows_each_level_as_often_as_the_table_says():
    cells = OffsetGrid(first_m=(-3.0, -3.0), cell_m=1.0, shape=(13, 7))
    movie = flies.movie_of(TABLE, cells)
    assert movie.shape == (flies.N_FRAMES, 7, 13)
    levels = (movie[..., None] > TABLE.thresholds_ppm).sum(axis=-1)
    shares = np.array([(levels == k).mean(axis=0) for k in range(3)]).transpose(0, 2, 1).reshape(3, -1)
    wanted = cells.looked_up(TABLE.level_frac, cells.centres_m())
    assert np.abs(shares - wanted).max() < 2.0 / flies.N_FRAMES
    assert shares.min() > 0.0


@pytest.mark.skipif(importlib.util.find_spec("olfactory_navigation") is not None, reason="it is installed")
def test_without_the_package_it_says_how_to_get_it():
    with pytest.raises(SystemExit, match=r"pip install 'gslcosim\[olfactory\]'"):
        Fly(briefing(sensors=PID))


@pytest.mark.slow
@pytest.mark.skipif(
    importlib.util.find_spec("olfactory_navigation") is None,
    reason="needs the extra: pip install 'gslcosim[olfactory]'",
)
@pytest.mark.parametrize("name", ["Infotaxis_Agent", "QMDP_Agent", "Perseus_Agent"])
def test_a_fly_flies_unit_moves_inside_the_room_and_believes(name):
    agent_briefing = briefing(
        sensors=PID, size_m=(6.0, 5.0, 3.0), parameters={"fly": name, "expansions": 5}, search_height_m=1.5
    )
    first, same, position_m = Fly(agent_briefing), Fly(agent_briefing), (4.0, 3.0, 1.5)
    for tick, ppm, notice in ((40, 0.0, None), (80, 2.0, None), (120, 0.0, "in an obstacle"), (160, 0.5, None)):
        told_now = seen(ppm, position_m, tick, notice=notice)
        command, again = first.decide(told_now), same.decide(told_now)
        assert command == again
        assert command.belief is None or command.belief.probability.to_array().sum() == pytest.approx(1.0, abs=1e-3)
        if command.kind == "waypoint":
            x_m, y_m, _ = command.position_world_m
            assert math.dist((x_m, y_m), position_m[:2]) == pytest.approx(1.0, abs=0.01)
            assert 0.5 <= x_m <= 5.5
            assert 0.5 <= y_m <= 4.5
            if tick != 80:
                position_m = (x_m, y_m, 1.5)
