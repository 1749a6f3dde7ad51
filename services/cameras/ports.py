"""Ports of the cameras service, known without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.messages import CameraFrames
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import list_event_reads
from gslcosim.scenario.models.events import DoorEventSpec


def cameras_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the cameras' dataflow: poses in, pictures out."""
    return ParticipantSpec(
        name="cameras",
        reads=(Read(port=keys.BODIES), *list_event_reads(scenario, DoorEventSpec)),
        writes=(Write(port=keys.IMAGES, message_type=CameraFrames),),
    )
