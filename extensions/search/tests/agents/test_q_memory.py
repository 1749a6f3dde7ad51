import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
from briefings import briefing, observation

from gslcosim_agents.q_memory import agent as program
from gslcosim_agents.q_memory.agent import QMemory
from gslcosim_search.reactive.temporal_memory import N_GAS_STATES, N_STATES, load_policies

WEST_RAD = math.pi  # the wind comes from -x
PID = (("pid", "nose"), ("anemometer", "vane"))
RECOVERIES = ("learned", "circling", "backtrack", "cast_surge")


def made(**changes):
    return QMemory(briefing(**{"sensors": PID, **changes}))


def at(tick, *, ppm=0.0, place_m=(7.0, 5.0, 2.0), notice=None):
    return observation(tick=tick, position_m=place_m, readings={"nose": ppm, "vane": (0.5, WEST_RAD)}, notice=notice)


def test_the_policies_have_a_row_for_each_state_and_a_value_for_each_move():
    tables = load_policies(program.POLICIES)
    assert {name: len(table) for name, table in tables.items()} == {
        name: N_STATES if name == "learned" else N_GAS_STATES for name in RECOVERIES
    }
    assert all(len(row) == 4 and all(map(math.isfinite, row)) for table in tables.values() for row in table)


def test_it_makes_the_move_of_the_table_relative_to_the_wind():
    for move, expected in enumerate([(-0.5, 0.0), (0.5, 0.0), (0.0, -0.5), (0.0, 0.5)]):
        agent = made()
        agent.table = [[1.0 if k == move else 0.0 for k in range(4)] for _ in range(N_STATES)]
        x_m, y_m, _ = agent.decide(at(40, ppm=1.0)).position_world_m
        assert (x_m - 7.0, y_m - 5.0) == pytest.approx(expected, abs=0.001)


@pytest.mark.parametrize("recovery", RECOVERIES)
def test_before_gas_it_explores_and_in_the_void_it_steps_on(recovery):
    agent = made(parameters={"recovery": recovery})
    assert math.dist(agent.decide(at(40)).position_world_m, (7.0, 5.0, 2.0)) != pytest.approx(0.5, abs=0.01)
    agent.decide(at(80, ppm=1.0))
    steps = [agent.decide(at(200 + 12 * i)).position_world_m for i in range(6)]
    assert all(math.dist(step, (7.0, 5.0, 2.0)) == pytest.approx(0.5, abs=0.001) for step in steps)


def test_backtracking_undoes_the_moves_since_the_last_gas():
    agent = made(parameters={"recovery": "backtrack", "adapts": False, "memory_s": 1.0})
    agent.table = [[1.0, 0.0, 0.0, 0.0]] * N_GAS_STATES
    ahead = agent.decide(at(40, ppm=1.0)).position_world_m
    back = agent.decide(at(60)).position_world_m
    assert ahead[0] == pytest.approx(6.5)
    assert back[0] == pytest.approx(7.5)


def test_the_trainers_recoveries_are_those_of_the_agent():
    """What was learned with a recovery is flown with the same one: circling and cast-surge, move by move."""
    from gslcosim_search.reactive.temporal_memory import CastSurge, Circling

    folder = Path(__file__).parents[4] / "docs" / "studies"
    spec = importlib.util.spec_from_file_location("q_memory_kernels", folder / "q_memory_kernels.py")
    kernels = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(kernels)

    class Chosen:
        """Draws that give what they are set to."""

        def __init__(self, index, fraction):
            self.index, self.fraction = (lambda n: index), (lambda: fraction)

    path, rng = np.zeros(1, np.int64), np.random.default_rng(1)
    for side, fraction in ((1, 0.1), (-1, 0.9)):
        for turn in range(4):
            circling = Circling(Chosen(turn, fraction))
            expected = [circling.next_move() for _ in range(30)]
            assert [kernels.recovery_move.py_func(1, n, path, 0, turn, side, rng) for n in range(1, 31)] == expected
        cast_surge = CastSurge(Chosen(0, fraction))
        expected = [cast_surge.next_move() for _ in range(30)]
        assert [kernels.recovery_move.py_func(2, n, path, 0, 0, side, rng) for n in range(1, 31)] == expected
