"""S-PSO: a particle swarm whose particles are robots, drawn to their own best reading and to the swarm's.

After Kennedy and Eberhart, and Jatmiko et al. for robots. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import run
from gslcosim_search.swarms.swarm_robot import Particle


class SPso(Particle):
    """One particle whose parameters were set by hand."""

    program = __file__


if __name__ == "__main__":
    run(SPso)
