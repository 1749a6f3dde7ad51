"""Registration and ports of the ROS 2 bridge, known without importing its messages."""

from gslcosim.contract import keys
from gslcosim.contract.participant import Core, ParticipantSpec, Read
from gslcosim.runtime.services import ServiceKind
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario
from gslcosim_ros.scenario_keys import LIVE_TOPICS

# It may lag as the recorder does: nobody waits for it until its buffers would grow without bound.
BRIDGE_WINDOW_TICKS = 512


def ros2_spec(scenario: Scenario) -> ParticipantSpec:
    """Return the bridge's dataflow: what agents get and command in, the truth where it is asked for, nothing out.

    Bodies and score are read for what they announce: commands and the verdict.
    """
    reads = [keys.BODIES, keys.SCORE, keys.VERDICT]
    for agent in scenario.agents:
        reads += [keys.observation(agent.name), keys.command(agent.name)]
    topics = LIVE_TOPICS.get(scenario)
    if topics is not None and topics.truth:
        reads += [keys.SAMPLES, keys.FILAMENTS]
    return ParticipantSpec(
        name="ros2", reads=tuple(Read(port=port) for port in reads), writes=(), window_ticks=BRIDGE_WINDOW_TICKS
    )


def _build(setup: RunSetup) -> Core:
    from gslcosim_ros.live.core import Ros2Core

    return Ros2Core(setup.scenario, setup.environment)


SERVICE = ServiceKind(
    name="ros2",
    build_spec=ros2_spec,
    build=_build,
    is_needed=LIVE_TOPICS.get,
    follows_agents=True,
    position=90,
)
