"""Registration of the world service."""

from gslcosim.contract.participant import Core
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup
from gslcosim.world.ports import world_spec


def _build(setup: Setup) -> Core:
    from gslcosim.world.core import WorldCore

    return WorldCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="world",
    spec_of=world_spec,
    build=_build,
    is_rehearsed=True,
    preloads=("gslcosim.world.core",),
    position=10,
)
