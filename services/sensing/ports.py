"""Ports of the sensing service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.messages import Briefing, Observation
from gslcosim.contract.participant import WINDOW_TICKS, ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import list_event_reads
from gslcosim.scenario.models.events import DoorEventSpec, SensorEventSpec

# Pictures are large: no more of them wait in memory.
PICTURES_WINDOW_TICKS = 64


def sensing_spec(scenario: Scenario) -> ParticipantSpec:
    """Return sensing's dataflow: poses, true samples and what is heard in, observations and, once, briefings out."""
    writes: list[Write] = []
    for agent in scenario.agents:
        writes.append(Write(port=keys.briefing(agent.name), message_type=Briefing, announced_in="once"))
        writes.append(Write(port=keys.observation(agent.name), message_type=Observation))
    radio = (Read(port=keys.RADIO),) if scenario.channels else ()
    images = (Read(port=keys.IMAGES),) if scenario.cameras else ()
    reads = (
        Read(port=keys.BODIES),
        Read(port=keys.SAMPLES),
        *radio,
        *images,
        *list_event_reads(scenario, SensorEventSpec, DoorEventSpec),
    )
    window_ticks = PICTURES_WINDOW_TICKS if scenario.cameras else WINDOW_TICKS
    return ParticipantSpec(name="sensing", reads=reads, writes=tuple(writes), window_ticks=window_ticks)
