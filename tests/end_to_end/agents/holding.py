"""Holds its place until the run ends: a flight that is long, even, and the same each time, by either door."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class Holding(Agent):
    def __init__(self, briefing: Briefing) -> None:
        del briefing

    def decide(self, observation: Observation) -> Command:
        return Command(tick=observation.tick, kind="hold")


if __name__ == "__main__":
    run(Holding)
