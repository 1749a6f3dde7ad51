"""PSO-WU: a particle swarm that uses the wind: steps downwind are turned away (I) or shortened (II).

After Jatmiko et al. README.md beside this file has the rules.
"""

import math

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.swarms.particle_swarm import Sighting, SwarmWeights, rotate_out_of_downwind, shorten_downwind
from gslcosim.search.swarms.swarm_robot import Particle, Vector


class PsoWu(Agent):
    """One particle; it remembers the last wind that was strong enough to have a direction."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.robot = Particle(briefing, self.settings)
        self.weights = SwarmWeights(inertia=self.settings.inertia, own=self.settings.own, swarm=self.settings.swarm)
        self.forbidden_rad = math.radians(self.settings.forbidden_deg)
        self.wind_m_s = np.zeros(2)

    def observe(self, observation: Observation) -> None:
        """Measure and listen."""
        self.robot.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: as in S-PSO, as the wind allows."""
        return self.robot.decide(observation, self.step)

    def step(self, best: Sighting | None) -> Vector:
        """Note the wind, and return the next step."""
        wind_m_s = self.robot.wind_m_s
        if math.hypot(*wind_m_s) > self.settings.wind_floor_m_s:
            self.wind_m_s = wind_m_s
        return self.robot.swarm_step(best, self.track)

    def track(self, best: Sighting) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers, turned or shortened by the wind."""
        step_m = self.robot.particle_step(best, self.weights)
        if self.settings.variant == "I":
            return rotate_out_of_downwind(step_m, self.wind_m_s, self.forbidden_rad)
        return shorten_downwind(step_m, self.wind_m_s)


if __name__ == "__main__":
    run(PsoWu)
