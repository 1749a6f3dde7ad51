import math

from briefings import briefing, observation

from gslcosim.base.bundled import bundled_agents
from gslcosim.runtime.agents.loader import load_python_agent

LevyWalker = load_python_agent(bundled_agents()["levy_walk"])


HERE_M = (7.0, 5.0, 2.0)


def lengths_m(n=300, **parameters):
    walker, here_m, found = LevyWalker(briefing(parameters=parameters)), HERE_M, []
    for _ in range(n):
        end_m = walker.decide(observation(position_m=here_m)).position_world_m
        found.append(math.dist(here_m, end_m))
        here_m = end_m
    return found


def test_a_larger_exponent_means_shorter_legs():
    assert sum(lengths_m(exponent=1.2)) > 1.3 * sum(lengths_m(exponent=3.0))
