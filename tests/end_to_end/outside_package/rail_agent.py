"""An agent that goes back and forth on its rail."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class RailAgent(Agent):
    """Goes one metre ahead and back again."""

    def __init__(self, briefing: Briefing) -> None:
        self.ends = 0

    def decide(self, observation: Observation) -> Command:
        """Return the other end of the rail."""
        self.ends += 1
        x_m, y_m, z_m = observation.position_world_m
        ahead_m = -1.0 if self.ends % 2 else 1.0
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(x_m + ahead_m, y_m, z_m))


if __name__ == "__main__":
    run(RailAgent)
