"""PSO-WU: a particle swarm that uses the wind: steps downwind are turned away (I) or shortened (II).

After Jatmiko et al. README.md beside this file has the rules.
"""

import math

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.swarms.particle_swarm import Sighting, rotate_out_of_downwind, shorten_downwind
from gslcosim.search.swarms.swarm_robot import ParticleAgent, Vector


class PsoWu(ParticleAgent):
    """One particle; it remembers the last wind that was strong enough to have a direction."""

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing, load_settings(briefing, __file__))
        self.forbidden_rad = math.radians(self.settings.forbidden_deg)
        self.wind_m_s = np.zeros(2)

    def step(self, best: Sighting | None) -> Vector:
        """Note the wind, and return the next step."""
        wind_m_s = self.robot.wind_m_s
        if math.hypot(*wind_m_s) > self.settings.wind_floor_m_s:
            self.wind_m_s = wind_m_s
        return super().step(best)

    def track(self, best: Sighting) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers, turned or shortened by the wind."""
        step_m = super().track(best)
        if self.settings.variant == "I":
            return rotate_out_of_downwind(step_m, self.wind_m_s, self.forbidden_rad)
        return shorten_downwind(step_m, self.wind_m_s)


if __name__ == "__main__":
    run(PsoWu)
