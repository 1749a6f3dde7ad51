"""Ports of the radio service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.messages import RadioTraffic
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import RadioEventSpec
from gslcosim.scenario.models.scenario import list_event_reads


def radio_spec(scenario: Scenario) -> ParticipantSpec:
    """Return radio's dataflow: where everybody was a tick ago and what was sent then in, what is heard now out.

    A command is read when it takes effect, so that nobody waits longer for an agent because it might send something.
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
