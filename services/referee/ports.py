"""Ports of the referee, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.messages import Score, Verdict
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import list_event_reads
from gslcosim.scenario.models.events import EventSpec


def referee_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the referee's dataflow: all truth and all checked commands in, the score and one verdict out."""
    commands = tuple(Read(port=keys.command(agent.name)) for agent in scenario.agents)
    return ParticipantSpec(
        name="referee",
        reads=(Read(port=keys.BODIES), Read(port=keys.SAMPLES), *commands, *list_event_reads(scenario, EventSpec)),
        writes=(
            Write(port=keys.SCORE, message_type=Score),
            Write(port=keys.VERDICT, message_type=Verdict, announced_in=keys.SCORE),
        ),
    )
