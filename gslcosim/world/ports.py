"""What the world reads and writes, known without building it."""

from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario


def world_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the world's dataflow: the agents' commands with their delays in, all true poses out."""
    return ParticipantSpec(
        name="world",
        reads=tuple(Read(port=keys.command(a.name), delay_ticks=a.latency_ticks) for a in scenario.agents),
        writes=(Write(port=keys.BODIES, message_type=BodyPoses),),
    )
