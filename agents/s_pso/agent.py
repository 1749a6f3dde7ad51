"""S-PSO: a particle swarm whose particles are robots, drawn to their own best reading and to the swarm's.

After Kennedy and Eberhart, and Jatmiko et al. for robots. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Briefing, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.swarms.swarm_robot import ParticleAgent


class SPso(ParticleAgent):
    """One particle whose parameters were set by hand."""

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing, load_settings(briefing, __file__))


if __name__ == "__main__":
    run(SPso)
