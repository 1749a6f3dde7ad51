"""A Python agent that raises at its third decision."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run


class GivingUp(Agent):
    def __init__(self, briefing: Briefing) -> None:
        self.n_decisions = 0

    def decide(self, observation: Observation) -> Command:
        self.n_decisions += 1
        if self.n_decisions == 3:
            raise RuntimeError("I give up")
        return Command(tick=observation.tick, kind="hold")


if __name__ == "__main__":
    run(GivingUp)
