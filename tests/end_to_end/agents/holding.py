"""Holds its place until the run ends: a run that is long, even, and the same each time, by either transport."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class Holding(Agent):
    def __init__(self, briefing: Briefing) -> None:
        del briefing

    def decide(self, observation: Observation) -> Command:
        return Command(tick=observation.tick, kind="hold")


if __name__ == "__main__":
    run(Holding)
