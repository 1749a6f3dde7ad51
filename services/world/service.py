"""Registration and ports of the world service, readable without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.environment_messages import WIND
from gslcosim.contract.messages import BodyPoses
from gslcosim.contract.participant import Core, ParticipantSpec, Read, Write
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.warmup import warm_up
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import DoorEventSpec, RotorWeakensSpec, WindChangesSpec
from gslcosim.scenario.models.scenario import list_event_reads


def world_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the world's dataflow: the agents' commands with their delays in, all true poses out."""
    commands = (Read(port=keys.command(a.name), delay_ticks=a.latency_ticks) for a in scenario.agents)
    wind = (Read(port=WIND, delay_ticks=1),) if scenario.has_driven_wind else ()
    return ParticipantSpec(
        name="world",
        reads=(*commands, *wind, *list_event_reads(scenario, RotorWeakensSpec, WindChangesSpec, DoorEventSpec)),
        writes=(Write(port=keys.BODIES, message_type=BodyPoses),),
    )


def _build(setup: RunSetup) -> Core:
    from gslcosim_services.world.core import WorldCore

    return warm_up(WorldCore(setup.scenario, setup.environment), setup.scenario)


SERVICE = ServiceKind(
    name="world",
    build_spec=world_spec,
    build=_build,
    is_warmed_up=True,
    preloads=("gslcosim_services.world.core",),
    position=10,
)
