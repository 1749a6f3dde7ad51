"""Registration of the cameras service."""

from gslcosim.cameras.ports import cameras_spec
from gslcosim.contract.participant import Core
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup


def _build(setup: Setup) -> Core:
    from gslcosim.cameras.core import CamerasCore

    return CamerasCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="cameras",
    spec_of=cameras_spec,
    build=_build,
    is_needed=lambda scenario: bool(scenario.cameras),
    position=50,
)
