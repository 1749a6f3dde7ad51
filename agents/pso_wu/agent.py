"""PSO-WU: a particle swarm that uses the wind: steps downwind are turned away (I) or shortened (II).

After Jatmiko et al. README.md beside this file has the rules.
"""

import math

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.elementary import norm2
from gslcosim_search.swarms.particle_swarm import Sighting, rotate_out_of_downwind, shorten_downwind
from gslcosim_search.swarms.swarm_robot import Particle, Vector


class PsoWu(Particle):
    """One particle; it remembers the last wind that was strong enough to have a direction."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.forbidden_rad = math.radians(self.settings.forbidden_deg)
        self.trusted_wind_m_s = np.zeros(2)

    def step(self, best: Sighting | None) -> Vector:
        """Note the wind, and return the next step."""
        if norm2(*self.wind_m_s) > self.settings.wind_floor_m_s:
            self.trusted_wind_m_s = self.wind_m_s
        return super().step(best)

    def track(self, best: Sighting) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers, turned or shortened by the wind."""
        step_m = super().track(best)
        if self.settings.variant == "I":
            return rotate_out_of_downwind(step_m, self.trusted_wind_m_s, self.forbidden_rad)
        return shorten_downwind(step_m, self.trusted_wind_m_s)


if __name__ == "__main__":
    run(PsoWu)
