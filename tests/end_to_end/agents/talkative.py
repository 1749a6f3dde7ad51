"""Flies across the room and says so on standard output."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class Talkative(Agent):
    """Prints a line at each decision."""

    def __init__(self, briefing: Briefing) -> None:
        self.bounds = briefing.bounds
        self.n_decided = 0

    def decide(self, observation: Observation) -> Command:
        """Fly a little there and back."""
        print("looking around")  # noqa: T201
        self.n_decided += 1
        x_m, y_m, z_m = observation.position_world_m
        step_m = 0.3 if self.n_decided % 2 else -0.3
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(x_m + step_m, y_m, z_m))


if __name__ == "__main__":
    run(Talkative)
