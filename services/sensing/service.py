"""Registration and ports of the sensing service, readable without building its core."""

from collections.abc import Mapping

from gslcosim.contract import keys
from gslcosim.contract.messages import Briefing, Observation
from gslcosim.contract.participant import WINDOW_TICKS, Core, ParticipantSpec, Read, Write
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.warmup import warm_up
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import DoorEventSpec, SensorEventSpec
from gslcosim.scenario.models.scenario import list_event_reads

# Pictures are large: no more of them wait in memory.
PICTURES_WINDOW_TICKS = 64


def sensing_spec(scenario: Scenario) -> ParticipantSpec:
    """Return sensing's dataflow: poses, true samples and radio messages in, observations and, once, briefings out."""
    writes: list[Write] = []
    for agent in scenario.agents:
        writes.append(Write(port=keys.briefing(agent.name), message_type=Briefing, announced_in="once"))
        writes.append(Write(port=keys.observation(agent.name), message_type=Observation))
    radio = (Read(port=keys.RADIO),) if scenario.channels else ()
    images = (Read(port=keys.IMAGES),) if scenario.cameras else ()
    reads = (
        Read(port=keys.BODIES),
        Read(port=keys.SAMPLES),
        *radio,
        *images,
        *list_event_reads(scenario, SensorEventSpec, DoorEventSpec),
    )
    window_ticks = PICTURES_WINDOW_TICKS if scenario.cameras else WINDOW_TICKS
    return ParticipantSpec(name="sensing", reads=reads, writes=tuple(writes), window_ticks=window_ticks)


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.sensing.core import SensingCore

    return warm_up(SensingCore(setup.scenario, setup.environment), setup.scenario)


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
