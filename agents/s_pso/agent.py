"""S-PSO: a particle swarm whose particles are robots, drawn to their own best reading and to the swarm's.

After Kennedy and Eberhart, and Jatmiko et al. for robots. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method import settings_of
from gslcosim.search.swarms.particle_swarm import Sighting, Weights
from gslcosim.search.swarms.swarming import Particle, Vector


class SPso(Agent):
    """One particle; it knows the others by radio only."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = settings_of(briefing, __file__)
        self.robot = Particle(briefing, self.settings)
        self.weights = Weights(inertia=self.settings.inertia, own=self.settings.own, swarm=self.settings.swarm)

    def observe(self, observation: Observation) -> None:
        """Measure and listen."""
        self.robot.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: away from who is near, to a random waypoint before any gas, else the swarm's step."""
        return self.robot.decide(observation, lambda best: self.robot.swarm_step(best, self.track))

    def track(self, best: Sighting) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers."""
        return self.robot.particle_step(best, self.weights)


if __name__ == "__main__":
    run(SPso)
