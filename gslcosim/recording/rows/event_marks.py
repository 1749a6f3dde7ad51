"""Marks of a scenario's events in the room: at the source or vehicle that they are about."""

from collections.abc import Mapping, Sequence

from gslcosim.contract.participant import Inbox
from gslcosim.recording import colors, entities
from gslcosim.recording.rows.agents import AgentRows
from gslcosim.recording.rows.columns import MarkerRows
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import due_events
from gslcosim.scenario.models.event_kinds import SourceEventSpec, SourceMovesSpec

_SOURCE_RADIUS_M = 0.14


class EventMarks:
    """Points with the words of what has happened there; events that are nowhere in the room have none."""

    def __init__(self, scenario: Scenario, agents: Mapping[str, AgentRows]) -> None:
        self._scenario = scenario
        self._agents = agents
        self._places_m = [source.position_m for source in scenario.gas.sources]
        self._sources = [MarkerRows(entity, radius_m=_SOURCE_RADIUS_M) for entity in entities.source_events(scenario)]

    def add(self, tick: int, inbox: Inbox) -> None:
        """Mark what takes effect in a tick."""
        for _, event in due_events(self._scenario, inbox):
            if isinstance(event, SourceEventSpec):
                if isinstance(event, SourceMovesSpec):
                    self._places_m[event.source] = event.to_m
                self._sources[event.source].add(tick, self._places_m[event.source], event.text, colors.SOURCE)
            elif event.about_agent is not None:
                agent = self._agents[event.about_agent]
                agent.markers.add(tick, agent.position_m, event.text, agent.names.color)

    def all(self) -> Sequence[MarkerRows]:
        """Return all rows but those of agents."""
        return self._sources
