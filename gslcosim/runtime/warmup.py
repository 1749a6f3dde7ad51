"""Warm-up before a run: two synthetic ticks, so that no kernel is compiled or loaded while simulated time passes."""

from collections.abc import Callable

import numpy as np

from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    BodyState,
    CameraFrame,
    CameraFrames,
    CameraImage,
    FieldSamples,
    Message,
    MountSample,
    RadioTraffic,
)
from gslcosim.contract.participant import Core, Episode, SupportsWarmup
from gslcosim.contract.record import NumericArray
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensors import ImuSensorSpec

N_WARMUP_TICKS = 2
_ZERO = (0.0, 0.0, 0.0)


def warm_up(core: Core, scenario: Scenario) -> Core:
    """Reset a core, step it with all vehicles at their starts, and return it; it must be reset before it is used.

    Compiling takes seconds on a machine's first run and loading a tenth of a second on every other; both would
    otherwise happen in the first ticks. A core that computes what these two ticks do not reach computes the rest by
    `SupportsWarmup`.
    """
    core.reset(Episode(seed=scenario.seed, is_warmup=True))
    ports = [read.port for read in core.spec.reads if read.port in _SYNTHETIC_MESSAGES]
    for tick in range(N_WARMUP_TICKS):
        core.step(tick, {port: _SYNTHETIC_MESSAGES[port](scenario, tick) for port in ports})
    if isinstance(core, SupportsWarmup):
        core.warm_up()
    return core


def build_resting_body(agent: AgentSpec) -> BodyState:
    """Return the state of an agent's vehicle before the first tick: at rest at its start."""
    has_imu = any(isinstance(sensor, ImuSensorSpec) for sensor in agent.sensors)
    return BodyState(
        agent=agent.name,
        position_world_m=agent.vehicle.start_m,
        quaternion_wxyz=(1.0, 0.0, 0.0, 0.0),
        velocity_world_m_s=_ZERO,
        angular_velocity_body_rad_s=_ZERO,
        phase="on_ground",
        awaiting_command=False,
        path_length_m=0.0,
        inertial_body=NumericArray.from_array(np.zeros((1, 9))) if has_imu else None,
    )


def _build_clean_samples(scenario: Scenario, tick: int) -> FieldSamples:
    samples = tuple(
        MountSample(agent=agent.name, sensor=sensor.name, gases=(), wind_world_m_s=_ZERO, beam_m=0.0)
        for agent in scenario.agents
        for sensor in agent.sensors
    )
    return FieldSamples(tick=tick, samples=samples)


def _build_blank_images(scenario: Scenario, tick: int) -> CameraFrames:
    image = CameraImage(
        encoding="png",
        width_px=1,
        height_px=1,
        focal_px=1.0,
        centre_px=(0.5, 0.5),
        position_body_m=_ZERO,
        quaternion_body_wxyz=(1.0, 0.0, 0.0, 0.0),
        taken_tick=tick,
        data=b"",
    )
    frames = (CameraFrame(agent=agent.name, sensor=sensor.name, image=image) for agent, sensor in scenario.cameras)
    return CameraFrames(tick=tick, frames=tuple(frames))


_SYNTHETIC_MESSAGES: dict[str, Callable[[Scenario, int], Message]] = {
    keys.BODIES: lambda scenario, tick: BodyPoses(tick=tick, bodies=tuple(map(build_resting_body, scenario.agents))),
    keys.SAMPLES: _build_clean_samples,
    keys.RADIO: lambda _, tick: RadioTraffic(tick=tick),
    keys.IMAGES: _build_blank_images,
}
