"""GSO: glowworm swarm optimisation for gas; who glows more is followed, and the brightest flies upwind.

After Krishnanand and Ghose, and the odour version of their group. README.md beside this file has the rules.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.swarms.glowworms import Glowworm, Vector
from gslcosim.search.swarms.particle_swarm import Sighting
from gslcosim.search.swarms.swarm_robot import SwarmAgent


class Gso(SwarmAgent[Glowworm]):
    """One glowworm."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.robot = Glowworm(briefing, self.settings)
        self.is_odour = self.settings.version == "odour"
        if not self.is_odour:
            self.robot.luciferin = self.settings.start_luciferin

    def step(self, best: Sighting | None) -> Vector:
        """Glow, look round, and return the next step; one that leads out of the room is cut at its wall."""
        robot = self.robot
        if self.is_odour:
            robot.glow_by_odour()
        else:
            robot.glow_by_decay(decay=self.settings.decay, gain=self.settings.gain)
        robot.numbers = (robot.luciferin,)
        social_m = robot.social_step()
        if social_m is not None:
            return social_m
        has_gas = best is not None and robot.luciferin > 0.0
        return self.lead() if has_gas else robot.spiral.step(robot.place_m)

    def lead(self) -> Vector:
        """Return the step of the brightest: upwind, or on its spiral in calm air; the basic rule stays."""
        if not self.is_odour:
            return np.zeros(2)
        upwind_m = self.robot.upwind_step()
        if upwind_m is None:
            return self.robot.spiral.step(self.robot.place_m)
        self.robot.spiral.forget()
        return upwind_m


if __name__ == "__main__":
    run(Gso)
