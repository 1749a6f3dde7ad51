"""DR-PSO: a particle swarm that spreads and forgets when its best has not got better for long (detect, respond).

After Jatmiko et al. README.md beside this file has the rules.
"""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.search.method_settings import load_settings
from gslcosim.search.swarms.particle_swarm import Sighting, Stagnation, SwarmWeights
from gslcosim.search.swarms.swarm_robot import Particle, Vector


class DrPso(Agent):
    """One particle; it counts how often the swarm has begun again, and hears no bests of before."""

    def __init__(self, briefing: Briefing) -> None:
        self.settings = load_settings(briefing, __file__)
        self.robot = Particle(briefing, self.settings)
        self.weights = SwarmWeights(inertia=self.settings.inertia, own=self.settings.own, swarm=self.settings.swarm)
        self.stagnation = Stagnation(self.settings.patience)
        self.n_restarts = 0
        self.n_spreading = 0

    def observe(self, observation: Observation) -> None:
        """Measure and listen; who hears that another one has begun again does so too."""
        for name, report in self.robot.observe(observation):
            n_restarts = int(report.numbers[0]) if report.numbers else 0
            if n_restarts > self.n_restarts:
                last = self.robot.team.reports[name]
                self.respond(n_restarts)
                self.robot.team.reports[name] = last
            elif n_restarts < self.n_restarts:
                self.robot.forget_best_of(name)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: as in S-PSO, but for the legs after a change."""
        return self.robot.decide(observation, self.step)

    def step(self, best: Sighting | None) -> Vector:
        """Return the next step; where the best has been the same for too long, begin again first."""
        if self.stagnation.note(best):
            self.respond(self.n_restarts + 1)
        if self.n_spreading > 0:
            self.n_spreading -= 1
            return self.robot.random_step()
        return self.robot.swarm_step(best, self.track)

    def respond(self, n_restarts: int) -> None:
        """Forget all bests; all robots, or every other one, spread."""
        self.n_restarts = n_restarts
        self.robot.numbers = (float(n_restarts),)
        self.robot.forget()
        if self.settings.spreads == "all" or self.robot.team.index % 2 == 0:
            self.n_spreading = self.settings.spread_legs

    def track(self, best: Sighting) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers."""
        return self.robot.particle_step(best, self.weights)


if __name__ == "__main__":
    run(DrPso)
