"""A scripted agent that is told where the source is and goes there; `crossings.py` flies it through whole runs."""

from gslcosim.agent_kit import Agent, Briefing, Command, Observation

SOURCE_M = (5.0, 1.0, 2.0)


class SentToTheSource(Agent):
    """Answers every question with the place of the source."""

    def __init__(self, briefing: Briefing) -> None:
        """Need nothing of the briefing."""
        del briefing

    def decide(self, observation: Observation) -> Command:
        """Go to the source."""
        return Command(tick=observation.tick, kind="waypoint", position_world_m=SOURCE_M)
