"""The agent of a plain particle swarm: as S-PSO flies it, with parameters set by hand or learned."""

from types import SimpleNamespace

from gslcosim.agent_kit import Agent, Briefing, Command, Observation
from gslcosim.search.swarms.particle_swarm import Sighting, Weights
from gslcosim.search.swarms.swarming import Particle, Vector


class ParticleAgent(Agent):
    """One particle; it knows the others by radio only.

    Its settings: those of a `Particle`, `inertia`, `own` and `swarm`.

    Held by:
        tests/unit/agents/test_s_pso.py
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace) -> None:
        """Begin without a best, a step and a waypoint."""
        self.settings = settings
        self.robot = Particle(briefing, settings)
        self.weights = Weights(inertia=settings.inertia, own=settings.own, swarm=settings.swarm)

    def observe(self, observation: Observation) -> None:
        """Measure and listen."""
        self.robot.observe(observation)

    def decide(self, observation: Observation) -> Command:
        """Return the next leg: away from who is near, to a random waypoint before any gas, else the swarm's step."""
        return self.robot.decide(observation, lambda best: self.robot.swarm_step(best, self.track))

    def track(self, best: Sighting) -> Vector:
        """Return the step of the equation of motion, with fresh random numbers."""
        return self.robot.particle_step(best, self.weights)
