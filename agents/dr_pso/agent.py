"""DR-PSO: a particle swarm that spreads and forgets when its best has not got better for long (detect, respond).

After Jatmiko et al. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Briefing, Observation, run
from gslcosim_search.swarms.particle_swarm import Sighting, Stagnation
from gslcosim_search.swarms.swarm_robot import Particle, Vector


class DrPso(Particle):
    """One particle; it counts how often the swarm has begun again, and hears no bests of before."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.stagnation = Stagnation(self.settings.patience)
        self.n_restarts = 0
        self.n_spreading = 0

    def observe(self, observation: Observation) -> None:
        """Measure and listen; who hears that another one has begun again does so too."""
        for name, report in self.listen(observation):
            n_restarts = int(report.numbers[0]) if report.numbers else 0
            if n_restarts > self.n_restarts:
                last = self.team.reports[name]
                self.respond(n_restarts)
                self.team.reports[name] = last
            elif n_restarts < self.n_restarts:
                self.forget_best_of(name)

    def step(self, best: Sighting | None) -> Vector:
        """Return the next step; where the best has been the same for too long, begin again first."""
        if self.stagnation.note(best):
            self.respond(self.n_restarts + 1)
        if self.n_spreading > 0:
            self.n_spreading -= 1
            return self.random_step()
        return super().step(best)

    def respond(self, n_restarts: int) -> None:
        """Forget all bests; all robots, or every other one, spread."""
        self.n_restarts = n_restarts
        self.numbers = (float(n_restarts),)
        self.forget()
        if self.settings.spreads == "all" or self.team.index % 2 == 0:
            self.n_spreading = self.settings.spread_legs


if __name__ == "__main__":
    run(DrPso)
