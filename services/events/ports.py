"""Ports of the events service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import EVENTS, EventsBeginning
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario


def events_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the dataflow of events: the subjects of their conditions in, the events that begin out."""
    triggers = [event.when for event in scenario.events if event.when is not None]
    bodies = (Read(port=keys.BODIES),) if any(each.within_m is not None for each in triggers) else ()
    samples = (Read(port=keys.SAMPLES),) if any(each.gas_above_ppm is not None for each in triggers) else ()
    ports = dict.fromkeys(each.value_port for each in triggers if each.value_port is not None)
    return ParticipantSpec(
        name="events",
        reads=(*bodies, *samples, *(Read(port=port) for port in ports)),
        writes=(Write(port=EVENTS, message_type=EventsBeginning),),
    )
