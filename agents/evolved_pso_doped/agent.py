"""Evolved PSO, doped: the particle swarm of S-PSO with parameters that were evolved with hard cases drawn more often.

README.md beside this file says how they were evolved, parameters.json has them.
"""

from gslcosim.agent_kit import Briefing, run
from gslcosim.agent_kit.settings import load_settings
from gslcosim_search.learned.policy_files import with_learned_parameters
from gslcosim_search.swarms.swarm_robot import Particle


class EvolvedPsoDoped(Particle):
    """One particle whose parameters were evolved."""

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing, with_learned_parameters(load_settings(briefing, __file__), __file__))


if __name__ == "__main__":
    run(EvolvedPsoDoped)
