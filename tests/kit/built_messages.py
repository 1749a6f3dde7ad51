"""Messages that tests make up: whole ones of which a test names what it is about."""

from typing import Any

from gslcosim.contract.messages import BodyPoses, BodyState, Bounds, Briefing, GasAmount, MountSample, Observation
from gslcosim.contract.version import CONTRACT_VERSION


def build_observation(tick: int = 0, **fields: Any) -> Observation:
    """Return an observation of a vehicle that holds at the origin and awaits a command, in ticks of 0.1 s."""
    whole = {
        "agent": "beetle",
        "time_s": tick / 10,
        "position_world_m": (0.0, 0.0, 0.0),
        "yaw_rad": 0.0,
        "velocity_world_m_s": (0.0, 0.0, 0.0),
        "status": "holding",
        "awaiting_command": True,
        "readings": (),
    }
    return Observation(tick=tick, **{**whole, **fields})


def build_briefing(**fields: Any) -> Briefing:
    """Return a briefing on request in a room of 9 x 9 x 3 m, with no sensors."""
    whole = {
        "tick": 0,
        "agent": "beetle",
        "contract_version": CONTRACT_VERSION,
        "mission": "",
        "tick_ns": 100_000_000,
        "seed": 1,
        "mode": "on_request",
        "latency_ticks": 1,
        "gas": "ethanol",
        "bounds": Bounds(min_m=(0.0, 0.0, 0.0), max_m=(9.0, 9.0, 3.0)),
        "search_height_m": 1.0,
        "hold_s": 1.0,
        "time_limit_s": 60.0,
        "sensors": (),
    }
    return Briefing(**{**whole, **fields})


def build_body(agent: str = "beetle", position_m=(0.0, 0.0, 0.0), **fields: Any) -> BodyState:
    """Return the state of a vehicle that flies level, without speed and without contacts."""
    whole = {
        "agent": agent,
        "position_world_m": position_m,
        "quaternion_wxyz": (1.0, 0.0, 0.0, 0.0),
        "velocity_world_m_s": (0.0, 0.0, 0.0),
        "angular_velocity_body_rad_s": (0.0, 0.0, 0.0),
        "phase": "flying",
        "awaiting_command": False,
        "path_length_m": 0.0,
    }
    return BodyState(**{**whole, **fields})


def build_poses(tick: int, *bodies: BodyState) -> BodyPoses:
    """Return the poses of vehicles at a tick, or of one that flies at the origin."""
    return BodyPoses(tick=tick, bodies=bodies or (build_body(),))


def build_sample(
    agent: str = "beetle", sensor: str = "nose", *, wind_m_s=(0.0, 0.0, 0.0), beam_m: float | None = None, **ppm: float
) -> MountSample:
    """Return the truth at a sensor: the wind, and the mixing ratio of each gas by its name."""
    gases = tuple(GasAmount(gas=gas, mixing_ratio_ppm=value) for gas, value in ppm.items())
    return MountSample(agent=agent, sensor=sensor, gases=gases, wind_world_m_s=wind_m_s, beam_m=beam_m)
