"""C-PSO: a particle swarm half of whose robots are charged and repel each other, so that some always search on.

After Blackwell and Bentley, and Jatmiko et al. for robots. README.md beside this file has the rules.
"""

import math

import numpy as np

from gslcosim.agent_kit import Briefing, run
from gslcosim_search.swarms.particle_swarm import Charge, Sighting, charge_velocity
from gslcosim_search.swarms.swarm_robot import Particle, Vector


class CPso(Particle):
    """One particle, charged or not by its place among the sorted names."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.charge = Charge(
            squared_m3=self.settings.charge_squared_m3, core_m=self.settings.core_m, reach_m=self.settings.reach_m
        )
        members = self.team.members
        self.charged = frozenset(members[: math.ceil(self.settings.charged_frac * len(members))])

    def step(self, best: Sighting | None) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers, and the push of the charges."""
        push_m = self.push_m()
        return self.swarm_step(best, lambda best: self.track(best) + push_m)

    def push_m(self) -> Vector:
        """Return what the other charged robots add to a charged one's step; nothing for one without charge."""
        team = self.team
        if team.name not in self.charged:
            return np.zeros(2)
        recent = team.recent(self.now_s)
        others_m = [report.position_m[:2] for name, report in recent.items() if name in self.charged]
        return charge_velocity(self.place_m, np.array(others_m).reshape(-1, 2), self.charge)


if __name__ == "__main__":
    run(CPso)
