import math
from itertools import pairwise

import pytest
from briefings import briefing, observation

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

PersistentWalk = load_python_agent(bundled_agents()["persistent_walk"])


HERE_M = (7.0, 5.0, 2.0)


def headings_rad(n=200, *, notice=None, **parameters):
    """Headings of its first n legs, all from the middle of the room."""
    walker = PersistentWalk(briefing(parameters=parameters))
    ends_m = [walker.decide(observation(position_m=HERE_M, notice=notice)).position_world_m for _ in range(n)]
    return [math.atan2(y_m - HERE_M[1], x_m - HERE_M[0]) for x_m, y_m, _ in ends_m]


def share_kept(headings):
    return sum(a == b for a, b in pairwise(headings)) / (len(headings) - 1)


@pytest.mark.parametrize("persistence", [0.0, 0.5, 0.9])
def test_it_keeps_its_heading_with_the_chance_that_it_is_given(persistence):
    error = 3.0 * math.sqrt(persistence * (1.0 - persistence) / 199)
    assert share_kept(headings_rad(persistence=persistence)) == pytest.approx(persistence, abs=error + 1e-9)


def test_it_never_turns_with_a_persistence_of_one_but_for_what_is_in_its_way():
    assert share_kept(headings_rad(persistence=1.0)) == 1.0
    assert share_kept(headings_rad(persistence=1.0, notice="in an obstacle")) == 0.0
