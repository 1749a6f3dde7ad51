"""Registration and ports of the cameras service, known without building its core."""

from operator import attrgetter

from gslcosim.contract import keys
from gslcosim.contract.messages import CameraFrames
from gslcosim.contract.participant import Core, ParticipantSpec, Read, Write
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import DoorEventSpec
from gslcosim.scenario.models.scenario import list_event_reads


def cameras_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the cameras' dataflow: poses in, pictures out."""
    return ParticipantSpec(
        name="cameras",
        reads=(Read(port=keys.BODIES), *list_event_reads(scenario, DoorEventSpec)),
        writes=(Write(port=keys.IMAGES, message_type=CameraFrames),),
    )


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.cameras.core import CamerasCore

    return CamerasCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="cameras",
    build_spec=cameras_spec,
    build=_build,
    is_needed=attrgetter("cameras"),
    position=50,
)
