"""Ports of the radio service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.messages import RadioTraffic
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import RadioEventSpec
from gslcosim.scenario.models.scenario import list_event_reads


def radio_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the radio's dataflow: bodies and texts of the last tick in, delivered texts out.

    A command is read when it takes effect, so that no participant waits longer for an agent that might send a text.
    """
    commands = (
        Read(port=keys.command(agent.name), delay_ticks=agent.latency_ticks)
        for agent in sorted(scenario.agents, key=lambda agent: agent.name)
    )
    return ParticipantSpec(
        name="radio",
        reads=(Read(port=keys.BODIES, delay_ticks=1), *commands, *list_event_reads(scenario, RadioEventSpec)),
        writes=(Write(port=keys.RADIO, message_type=RadioTraffic),),
    )
