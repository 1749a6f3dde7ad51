"""What the cameras read and write, known without building them."""

from gslcosim.contract import keys
from gslcosim.contract.messages import CameraFrames
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import reads_of_events
from gslcosim.scenario.models.event_kinds import DoorEventSpec


def cameras_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the cameras' dataflow: poses in, pictures out."""
    return ParticipantSpec(
        name="cameras",
        reads=(Read(port=keys.BODIES), *reads_of_events(scenario, DoorEventSpec)),
        writes=(Write(port=keys.IMAGES, message_type=CameraFrames),),
    )
