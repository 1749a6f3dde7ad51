"""Registration of the sensing service."""

from collections.abc import Mapping

from gslcosim.contract.messages import Briefing
from gslcosim.contract.participant import Core
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim_services.sensing.ports import sensing_spec


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.sensing.core import SensingCore

    return SensingCore(setup.scenario, setup.environment)


def _build_briefings(setup: RunSetup) -> Mapping[str, Briefing]:
    from gslcosim_services.sensing.briefing import build_briefing

    scenario = setup.scenario
    return {
        agent.name: build_briefing(agent, scenario, setup.environment, seed=scenario.seed) for agent in scenario.agents
    }


SERVICE = ServiceKind(
    name="sensing",
    build_spec=sensing_spec,
    build=_build,
    is_warmed_up=True,
    preloads=("gslcosim_services.sensing.core",),
    position=60,
    build_briefings=_build_briefings,
)
