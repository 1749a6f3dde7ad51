"""Registration and ports of the referee, readable without building its core."""

from gslcosim.contract import keys
from gslcosim.contract.messages import Score, Verdict
from gslcosim.contract.participant import Core, ParticipantSpec, Read, Write
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import EventSpec
from gslcosim.scenario.models.scenario import list_event_reads


def referee_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the referee's dataflow: all truth and all checked commands in, the score and one verdict out."""
    commands = tuple(Read(port=keys.command(agent.name)) for agent in scenario.agents)
    return ParticipantSpec(
        name="referee",
        reads=(Read(port=keys.BODIES), Read(port=keys.SAMPLES), *commands, *list_event_reads(scenario, EventSpec)),
        writes=(
            Write(port=keys.SCORE, message_type=Score),
            Write(port=keys.VERDICT, message_type=Verdict, announced_in=keys.SCORE),
        ),
    )


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
