"""Registration of the referee service."""

from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.referee.ports import referee_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.referee.core import RefereeCore

    return RefereeCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="referee",
    build_spec=referee_spec,
    build=_build,
    preloads=("gslcosim_services.referee.core",),
    follows_agents=True,
    position=70,
)
