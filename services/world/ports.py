"""Ports of the world service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.messages import BodyPoses
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import list_event_reads
from gslcosim.scenario.models.events import DoorEventSpec, RotorWeakensSpec, WindChangesSpec


def world_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the world's dataflow: the agents' commands with their delays in, all true poses out."""
    commands = (Read(port=keys.command(a.name), delay_ticks=a.latency_ticks) for a in scenario.agents)
    wind = (Read(port=WIND, delay_ticks=1),) if scenario.has_driven_wind else ()
    return ParticipantSpec(
        name="world",
        reads=(*commands, *wind, *list_event_reads(scenario, RotorWeakensSpec, WindChangesSpec, DoorEventSpec)),
        writes=(Write(port=keys.BODIES, message_type=BodyPoses),),
    )
