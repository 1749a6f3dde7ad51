"""Two made-up ticks before a run, so that no kernel is compiled or loaded while simulated time passes."""

from gslcosim.contract import keys
from gslcosim.contract.messages import BodyPoses, BodyState
from gslcosim.contract.participant import Core, Episode
from gslcosim.scenario import Scenario

REHEARSED = ("world", "fields")
N_TICKS = 2


def rehearse(core: Core, scenario: Scenario) -> None:
    """Reset a core and step it with all vehicles at their starts; it must be reset before it is used.

    Compiling takes seconds on a machine's first run and loading a tenth of a second on every other; both would
    otherwise happen in the first ticks.
    """
    core.reset(Episode(seed=scenario.seed))
    reads_bodies = any(read.port == keys.BODIES for read in core.spec.reads)
    for tick in range(N_TICKS):
        core.step(tick, {keys.BODIES: _at_start(scenario, tick)} if reads_bodies else {})


def _at_start(scenario: Scenario, tick: int) -> BodyPoses:
    still = (0.0, 0.0, 0.0)
    bodies = tuple(
        BodyState(
            agent=agent.name,
            position_world_m=agent.vehicle.start_m,
            quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
            velocity_world_m_s=still,
            angular_velocity_body_rad_s=still,
            phase="on_ground",
            awaiting_command=False,
            path_length_m=0.0,
        )
        for agent in scenario.agents
    )
    return BodyPoses(tick=tick, bodies=bodies)
