"""Briefing of an agent: task, limits, sensors, and the map and plume that it is granted to know."""

import math

import numpy as np

from gslcosim.base.rng import stream
from gslcosim.contract.messages import CONTRACT_VERSION, Bounds, Briefing, ChannelDescription, KnownMap, NominalPlume
from gslcosim.contract.record import NumericArray
from gslcosim.contract.schema import get_contract_hash
from gslcosim.environment.model import Cell, Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim_services.sensing.sensor_descriptions import describe_sensors


def build_known_map(agent: AgentSpec, environment: Environment) -> KnownMap | None:
    """Build the map that an agent is granted, or None where it is granted none.

    A slice is cut through the cells at the agent's search height; at the ceiling or above it through the topmost.
    """
    if not agent.knows.map:
        return None
    grid = environment.grid
    solid = (environment.occupancy == Cell.SOLID).astype(np.uint8)
    x_m, y_m, z_m = (float(value) for value in grid.origin_m)
    if agent.knows.map == "3d":
        return KnownMap(origin_m=(x_m, y_m, z_m), cell_m=grid.cell_m, occupied=NumericArray.from_array(solid))
    height_m = agent.vehicle.search_height_m
    layer = min(max(int((height_m - z_m) / grid.cell_m), 0), grid.shape[2] - 1)
    slice_ = np.ascontiguousarray(solid[:, :, layer])
    return KnownMap(
        origin_m=(x_m, y_m, height_m), cell_m=grid.cell_m, occupied=NumericArray.from_array(slice_), height_m=height_m
    )


def build_nominal_plume(scenario: Scenario) -> NominalPlume:
    """Return nominal figures of the plume: those of the first source, and the speed of the wind at the inlet.

    Q = rate ppm0 (2 pi)^(3/2) sigma0^3        [ppm m^3/s] = [1/s] [ppm] [m^3]

    Q is what the integral of the mixing ratio over all space gains a second; a filament with the mixing ratio ppm0 at
    its centre and the standard deviation sigma0 holds (2 pi)^(3/2) sigma0^3 ppm0.

    Held by:
        tests/unit/services/sensing/test_briefing.py
    """
    gas, source = scenario.gas, scenario.gas.sources[0]
    # A model without filaments has no spread of its own; its figures are those that filaments usually have.
    usual = FilamentsSpec.model_fields
    growth_m2_s = gas.growth_m2_s if isinstance(gas, FilamentsSpec) else usual["growth_m2_s"].default
    diffusivity_m2_s = (
        gas.eddy_diffusivity_m2_s if isinstance(gas, FilamentsSpec) else usual["eddy_diffusivity_m2_s"].default
    )
    puff_ppm_m3 = source.ppm * (2.0 * math.pi) ** 1.5 * source.sigma_m**3
    return NominalPlume(
        release_ppm_m3_s=source.filaments_per_s * puff_ppm_m3,
        puffs_per_s=source.filaments_per_s,
        initial_sigma_m=source.sigma_m,
        growth_m2_s=growth_m2_s,
        diffusivity_m2_s=diffusivity_m2_s,
        wind_speed_m_s=math.hypot(*scenario.wind.inlet_velocity_m_s),
    )


FREE_MODE_NOTE = " Time does not wait for answers: they take effect when they come."


def build_briefing(agent: AgentSpec, scenario: Scenario, environment: Environment, *, seed: int) -> Briefing:
    """Build an agent's briefing: task, room, limits, sensors, a seed of its own, and the knowledge it is granted.

    Args:
        agent: Whose briefing.
        scenario: The run's scenario.
        environment: The run's room; the agent learns its bounds, and the map only where it is granted.
        seed: The run's seed; the agent's own derives from it and does not reveal it.
    """
    grid = environment.grid
    return Briefing(
        tick=0,
        agent=agent.name,
        contract_version=CONTRACT_VERSION,
        mission=mission_text(scenario) + (FREE_MODE_NOTE if agent.is_free else ""),
        tick_ns=scenario.tick_ns,
        seed=_derive_agent_seed(agent, seed),
        # It is asked at its waypoints, too; the contract has no word for a question that nobody waits for.
        mode="on_request" if agent.mode_name == "free" else agent.mode_name,
        latency_ticks=agent.latency_ticks,
        gas=scenario.gas.gas,
        bounds=Bounds(min_m=_floats(grid.origin_m), max_m=_floats(grid.max_m)),
        search_height_m=agent.vehicle.search_height_m,
        hold_s=agent.vehicle.hold_s,
        time_limit_s=scenario.referee.stop.time_limit_s,
        sensors=describe_sensors(agent, scenario),
        contract_hash=get_contract_hash(),
        channels=_describe_channels(agent, scenario),
        parameters=agent.parameters,
        known_map=build_known_map(agent, environment),
        plume=build_nominal_plume(scenario) if agent.knows.plume else None,
        known_sources=tuple(source.position_m for source in scenario.gas.sources) if agent.knows.source else (),
    )


def _derive_agent_seed(agent: AgentSpec, run_seed: int) -> int:
    return int(stream(run_seed, f"agent.{agent.name}").integers(2**31)) if agent.seed is None else agent.seed


def _describe_channels(agent: AgentSpec, scenario: Scenario) -> tuple[ChannelDescription, ...]:
    return tuple(
        ChannelDescription(
            name=channel.name,
            members=scenario.members_of(channel),
            range_m=channel.range_m,
            delay_ticks=channel.delay_ticks,
            max_bytes=channel.max_bytes,
        )
        for channel in scenario.channels
        if agent.name in scenario.members_of(channel)
    )


def mission_text(scenario: Scenario) -> str:
    """Return the task in one sentence."""
    referee = scenario.referee
    return f"{referee.success.task_text(scenario.gas.gas)} in at most {referee.stop.time_limit_s:g} s."


def _floats(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))
