"""GSO: glowworm swarm optimisation for gas; who glows more is followed, and the brightest flies upwind.

After Krishnanand and Ghose, and the odour version of their group. README.md beside this file has the rules.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.swarms.glowworms import Glowworm, Vector
from gslcosim_search.swarms.particle_swarm import Sighting


class Gso(Glowworm):
    """One glowworm."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.is_odour = self.settings.version == "odour"
        if not self.is_odour:
            self.luciferin = self.settings.start_luciferin

    def step(self, best: Sighting | None) -> Vector:
        """Glow, look round, and return the next step; one that leads out of the room is cut at its wall."""
        if self.is_odour:
            self.glow_by_odour()
        else:
            self.glow_by_decay(decay=self.settings.decay, gain=self.settings.gain)
        self.numbers = (self.luciferin,)
        social_m = self.social_step()
        if social_m is not None:
            return social_m
        has_gas = best is not None and self.luciferin > 0.0
        return self.lead() if has_gas else self.spiral.step(self.place_m)

    def lead(self) -> Vector:
        """Return the step of the brightest: upwind, or on its spiral in calm air; the basic rule stays."""
        if not self.is_odour:
            return np.zeros(2)
        upwind_m = self.upwind_step()
        if upwind_m is None:
            return self.spiral.step(self.place_m)
        self.spiral.forget()
        return upwind_m


if __name__ == "__main__":
    run(Gso)
