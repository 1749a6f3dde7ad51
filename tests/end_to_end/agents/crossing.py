"""A Python agent that flies to the mirror image of where it is, in a room 8 m long."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class Crossing(Agent):
    def __init__(self, briefing: Briefing) -> None:
        del briefing

    def decide(self, observation: Observation) -> Command:
        x_m, _, _ = observation.position_world_m
        return Command(tick=observation.tick, kind="waypoint", position_world_m=(round(8.0 - x_m), 2.0, 1.0))


if __name__ == "__main__":
    run(Crossing)
