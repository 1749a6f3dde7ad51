"""Source map: a probability for each cell of the floor, from puffs of gas that are traced back with the wind.

After Pang and Farrell 2006. README.md beside this file has the rules, method.yaml the parameters.
"""

from gslcosim.agent_kit import run
from gslcosim_search.bayes.belief_search import PuffTracingAgent


class SourceMapAgent(PuffTracingAgent):
    """Traces each finding back with the wind; goes upwind after gas, else where that tells most."""

    program = __file__


if __name__ == "__main__":
    run(SourceMapAgent)
