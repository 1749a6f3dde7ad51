"""Agents that share what they know inside their process: each answer counts all observations of all of them so far."""

from gslcosim.agent_kit import Agent, Command, run

SEEN = []


class Sharing(Agent):
    def __init__(self, briefing):
        SEEN.append(briefing.agent)

    def observe(self, observation):
        SEEN.append((observation.agent, observation.tick))

    def decide(self, observation):
        return Command(tick=observation.tick, kind="noop", reason=f"{len(SEEN)} after {SEEN[-2]}")


if __name__ == "__main__":
    run(Sharing)
