"""Registration of the world service."""

from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.world.ports import world_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.world.core import WorldCore

    return WorldCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="world",
    build_spec=world_spec,
    build=_build,
    is_warmed_up=True,
    preloads=("gslcosim_services.world.core",),
    position=10,
)
