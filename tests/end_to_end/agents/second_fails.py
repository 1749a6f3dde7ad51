"""Agents that hold; the one called beetle_2 loses its way after five decisions."""

from gslcosim.agent_kit import Agent, Command, run


class SecondFails(Agent):
    def __init__(self, briefing):
        self.name = briefing.agent
        self.n_decisions = 0

    def decide(self, observation):
        self.n_decisions += 1
        if self.name == "beetle_2" and self.n_decisions > 5:
            raise RuntimeError("lost my way")
        return Command(tick=observation.tick, kind="hold")


if __name__ == "__main__":
    run(SecondFails)
