"""Registration of the referee service."""

from gslcosim.contract.participant import Core
from gslcosim.referee.ports import referee_spec
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup


def _build(setup: Setup) -> Core:
    from gslcosim.referee.core import RefereeCore

    return RefereeCore(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="referee",
    spec_of=referee_spec,
    build=_build,
    preloads=("gslcosim.referee.core",),
    follows_agents=True,
    position=70,
)
