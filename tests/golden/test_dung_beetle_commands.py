"""What the dung beetle answers to a fixed series of observations, for implementations in other languages.

The series is not physical: it visits walls, corners, refusals, rising and falling ohms, and every wind direction.
"""

import json

import pytest
from briefings import observation
from languages import golden_briefing

from gslcosim_agents.dung_beetle.agent import DungBeetle

N_OBSERVATIONS = 60
SEEDS = (1, 2, 2**31 - 1)
MAX_M = (15.0, 9.0, 8.0)


def series(seed: int):
    """Yield ohms, upwind direction, position and notice; sevenths and such make last bits matter."""
    for i in range(N_OBSERVATIONS):
        k = i + 17 * seed
        ohm = 50_000.0 if i < 8 else 40_000.0 + 1000.0 * ((k * 7) % 11)
        upwind_rad = ((k * 29) % 44 - 22) / 7.0
        position_m = (0.3 + ((k * 13) % 29) / 2.0, 0.2 + ((k * 5) % 17) / 2.0 + 1.0 / 3.0, 2.0 + 0.001 * (k % 3))
        yield ohm, upwind_rad, position_m, "refused" if k % 9 == 4 else None


def observations(seed: int):
    for tick, (ohm, upwind_rad, position_m, notice) in enumerate(series(seed)):
        readings = {"nose": ohm, "wind": (0.5, upwind_rad)}
        yield observation(tick=tick, name="beetle", position_m=position_m, readings=readings, notice=notice)


def answer(seed: int) -> list[dict[str, object]]:
    beetle = DungBeetle(golden_briefing(seed))
    return [
        {
            "ohm": seen.reading("nose").values[0],
            "upwind_rad": seen.reading("wind").values[1],
            "position_m": seen.position_world_m,
            "notice": seen.notice,
            "goal_m": beetle.decide(seen).position_world_m,
        }
        for seen in observations(seed)
    ]


def test_the_answers_are_the_golden_ones(golden):
    vectors = [{"seed": seed, "max_m": MAX_M, "steps": answer(seed)} for seed in SEEDS]
    rows = [json.dumps(vector, separators=(",", ":")).replace('{"ohm"', '\n{"ohm"') for vector in vectors]
    golden("dung_beetle_commands.json", "[\n" + ",\n".join(rows) + "\n]\n")


@pytest.mark.parametrize("seed", SEEDS)
def test_the_series_seeks_zigzags_both_ways_and_draws(seed):
    """Otherwise the vectors would not tell a wrong implementation from a right one."""
    beetle = DungBeetle(golden_briefing(seed))
    sides = set()
    for seen in observations(seed):
        beetle.decide(seen)
        sides.add(beetle.side)
    assert sides == {0, 1, -1}
    assert beetle.random_state != seed
