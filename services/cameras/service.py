"""Registration of the cameras service."""

from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.cameras.ports import cameras_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.cameras.core import CamerasCore

    return CamerasCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="cameras",
    build_spec=cameras_spec,
    build=_build,
    is_needed=lambda scenario: bool(scenario.cameras),
    position=50,
)
