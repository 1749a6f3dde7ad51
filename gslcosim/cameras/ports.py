"""What the cameras read and write, known without building them."""

from gslcosim.contract import keys
from gslcosim.contract.messages import CameraFrames
from gslcosim.contract.participant import ParticipantSpec, Read, Write
from gslcosim.scenario import Scenario


def cameras_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the cameras' dataflow: poses in, pictures out."""
    return ParticipantSpec(
        name="cameras",
        reads=(Read(port=keys.BODIES),),
        writes=(Write(port=keys.IMAGES, message_type=CameraFrames),),
    )
