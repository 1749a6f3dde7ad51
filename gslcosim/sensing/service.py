"""Registration of the sensing service."""

from collections.abc import Mapping

from gslcosim.contract.messages import Briefing
from gslcosim.contract.participant import Core
from gslcosim.runtime.participants import ServiceKind
from gslcosim.runtime.setup import Setup
from gslcosim.sensing.ports import sensing_spec


def _build(setup: Setup) -> Core:
    from gslcosim.sensing.core import SensingCore

    return SensingCore(setup.scenario, setup.environment)


def _build_briefings(setup: Setup) -> Mapping[str, Briefing]:
    from gslcosim.sensing.briefings import briefing_of

    scenario = setup.scenario
    return {
        agent.name: briefing_of(agent, scenario, setup.environment, seed=scenario.seed) for agent in scenario.agents
    }


SERVICE = ServiceKind(
    name="sensing",
    spec_of=sensing_spec,
    build=_build,
    is_rehearsed=True,
    preloads=("gslcosim.sensing.core",),
    position=60,
    build_briefings=_build_briefings,
)
