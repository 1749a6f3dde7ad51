"""Ports of the events service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario


def events_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of events: the truth that their conditions are about in, and which of them begin out."""
    triggers = [event.when for event in scenario.events if event.when is not None]
    bodies = (Read(port=keys.BODIES),) if any(each.within_m is not None for each in triggers) else ()
    samples = (Read(port=keys.SAMPLES),) if any(each.gas_above_ppm is not None for each in triggers) else ()
    return ParticipantSpec(
        name="events",
        reads=(*bodies, *samples),
        writes=(Write(port=EVENTS, message_type=EventsBeginning),),
    )
