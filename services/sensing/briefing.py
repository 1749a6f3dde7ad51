"""Briefing of an agent: task, limits, sensors, granted map and plume, and the check of its method's needs."""

import math
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from gslcosim.base.bundled import find_bundled_agent
from gslcosim.base.errors import MethodError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import ESTIMATE_QUANTITY
from gslcosim.base.rng import stream
from gslcosim.base.scalar_kernels import norm3
from gslcosim.contract.messages import (
    Bounds,
    Briefing,
    ChannelDescription,
    KnownMap,
    NominalPlume,
    SensorDescription,
    Task,
)
from gslcosim.contract.record import NumericArray
from gslcosim.contract.version import CONTRACT_HASH, CONTRACT_VERSION
from gslcosim.environment.model import Cell, Environment
from gslcosim.methods.card import CARD_FILE, MethodCard, find_card_beside, find_unmet_needs
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim.scenario.models.scenario import AgentSpec, RefereeSpec
from gslcosim.scenario.models.sensors import RaySensorSpec, TurnedSensorSpec, real_model
from gslcosim.scenario.models.success import MapSuccess
from gslcosim_services.sensing.models import SensorKind, sensor_kind, sensor_names
from gslcosim_services.sensing.models.base import estimate_name
from gslcosim_services.sensing.models.mox import ESTIMATE_UNIT
from gslcosim_services.sensing.models.range_finders import ray_directions_body

FREE_MODE_NOTE = " Time does not wait for answers: they take effect when they come."


def find_sensor_kind(scenario: Scenario, model: str) -> SensorKind:
    """Return a sensor model as it is in a scenario that may define gases of its own."""
    kind, definitions = sensor_kind(model), scenario.gas.define
    return kind.for_gases(definitions) if definitions and kind.for_gases else kind


def describe_sensors(agent: AgentSpec, scenario: Scenario) -> tuple[SensorDescription, ...]:
    """Describe an agent's sensors to it: first those it has, then the estimates from their readings."""
    kinds = [(sensor, find_sensor_kind(scenario, sensor.model)) for sensor in agent.sensors]
    sensors = tuple(
        SensorDescription(
            name=sensor.name,
            model=real_model(sensor.model),
            quantity=kind.quantity,
            unit=kind.unit,
            mount_body_m=sensor.mount_m,
            mount_rpy_rad=sensor.mount_rpy_rad if isinstance(sensor, TurnedSensorSpec) else (0.0, 0.0, 0.0),
            directions_body=NumericArray.from_array(ray_directions_body(sensor).astype(np.float32))
            if isinstance(sensor, RaySensorSpec)
            else None,
        )
        for sensor, kind in kinds
    )
    estimates = tuple(
        SensorDescription(
            name=estimate_name(sensor.name),
            model=real_model(sensor.model),
            quantity=ESTIMATE_QUANTITY,
            unit=ESTIMATE_UNIT,
            mount_body_m=sensor.mount_m,
        )
        for sensor, kind in kinds
        if kind.estimator and kind.estimator(scenario.gas.gas)
    )
    return sensors + estimates


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
    slice_ = np.ascontiguousarray(solid[:, :, grid.index_at(2, height_m)])
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
    gas, source = scenario.gas, scenario.gas.searched[0]
    # A model without filaments has no spread of its own; its figures are those that filaments usually have.
    usual = FilamentsSpec.model_fields
    growth_m2_s = gas.growth_m2_s if isinstance(gas, FilamentsSpec) else usual["growth_m2_s"].default
    diffusivity_m2_s = (
        gas.eddy_diffusivity_m2_s if isinstance(gas, FilamentsSpec) else usual["eddy_diffusivity_m2_s"].default
    )
    puff_ppm_m3 = (
        source.ppm * 2.0 * math.pi * math.sqrt(2.0 * math.pi) * (source.sigma_m * source.sigma_m * source.sigma_m)
    )
    return NominalPlume(
        release_ppm_m3_s=source.filaments_per_s * puff_ppm_m3,
        puffs_per_s=source.filaments_per_s,
        initial_sigma_m=source.sigma_m,
        growth_m2_s=growth_m2_s,
        diffusivity_m2_s=diffusivity_m2_s,
        wind_speed_m_s=norm3(*scenario.wind.inlet_velocity_m_s),
    )


def build_briefing(agent: AgentSpec, scenario: Scenario, environment: Environment, *, seed: int) -> Briefing:
    """Build an agent's briefing: task, room, limits, sensors, a seed of its own, and the knowledge it is granted.

    Args:
        environment: The run's room; the agent receives its bounds, and the map only where it is granted.
        seed: The run's seed; the agent's own derives from it and does not reveal it.
    """
    grid, task = environment.grid, build_task(scenario.referee)
    sentence = f"{scenario.referee.success.task_text(scenario.gas.gas)} in at most {task.time_limit_s:g} s."
    return Briefing(
        tick=0,
        agent=agent.name,
        contract_version=CONTRACT_VERSION,
        mission=sentence + (FREE_MODE_NOTE if agent.is_free else ""),
        tick_ns=scenario.tick_ns,
        seed=int(stream(seed, f"agent.{agent.name}").integers(2**31)) if agent.seed is None else agent.seed,
        # The agent is due at its waypoints, too; the contract has no word for a request that no process waits for.
        mode="on_request" if agent.mode_name == "free" else agent.mode_name,
        latency_ticks=agent.latency_ticks,
        gas=scenario.gas.gas,
        bounds=Bounds(min_m=_floats(grid.origin_m), max_m=_floats(grid.max_m)),
        search_height_m=agent.vehicle.search_height_m,
        hold_s=agent.vehicle.hold_s,
        time_limit_s=task.time_limit_s,
        sensors=describe_sensors(agent, scenario),
        contract_hash=CONTRACT_HASH,
        channels=_describe_channels(agent, scenario),
        parameters=agent.parameters,
        known_map=build_known_map(agent, environment),
        plume=build_nominal_plume(scenario) if agent.knows.plume else None,
        known_sources=tuple(source.position_m for source in scenario.gas.searched) if agent.knows.source else (),
        task=task,
    )


def build_task(referee: RefereeSpec) -> Task:
    """Build the task of a scenario's agents from its success criterion and its limits."""
    success = referee.success
    return Task(
        goal=success.of,
        success_radius_m=float(success.within_m),
        time_limit_s=float(referee.stop.time_limit_s),
        distance_of=success.distance_of,
        is_horizontal=success.is_horizontal,
        mass_at_least=success.mass_at_least if isinstance(success, MapSuccess) else None,
        asks_for_declaration=success.asks_for_declaration,
        n_sources=success.n_sources,
    )


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


def _floats(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    return (float(vector[0]), float(vector[1]), float(vector[2]))


def find_method_problems(scenario: Scenario, directory: Path) -> Iterator[Problem]:
    """Yield the reasons why methods of a scenario cannot run; agents without a card are passed over.

    Args:
        directory: The scenario's folder, where relative paths of agents start.
    """
    by_name = {agent.name: agent for agent in scenario.agents}
    for i, agent in enumerate(scenario.agents):
        host = by_name.get(agent.process, agent)
        card = None
        try:
            card = _find_card(host, directory)
        except MethodError as error:
            text, _, file = str(error).rpartition("\nFile: ")
            yield Problem(
                where=f"agents[{i}].start",
                expected=f"an agent with a right {CARD_FILE}",
                found="one whose card is not",
                remedy=f"{file}: {text.rstrip('.')}.",
            )
        if card is not None and all(sensor.model in sensor_names() for sensor in agent.sensors):
            yield from _find_problems(i, agent, card, scenario)
            yield from _find_missing_files(i, agent, card, directory)


# A method without a sandbox has the shell's folder; one that is started as a program has the scenario's.
def _find_missing_files(i: int, agent: AgentSpec, card: MethodCard, directory: Path) -> Iterator[Problem]:
    for name, parameter in card.parameters.items():
        value = agent.parameters.get(name)
        if parameter.kind != "file" or not isinstance(value, str) or not Path(value).suffix:
            continue
        if not Path(value).is_file() and not (directory / value).is_file():
            yield Problem(
                where=f"agents[{i}].parameters.{name}",
                expected="a file, or a name without an ending",
                found=f"'{value}'",
                remedy=f"There is no {(directory / value).resolve()}.",
            )


def _find_problems(i: int, agent: AgentSpec, card: MethodCard, scenario: Scenario) -> Iterator[Problem]:
    shortages = find_unmet_needs(
        card,
        sensors=describe_sensors(agent, scenario),
        knows=agent.knows.granted,
        n_channels=sum(agent.name in scenario.members_of(channel) for channel in scenario.channels),
        parameters=agent.parameters,
    )
    for shortage in shortages:
        yield replace(shortage, where=f"agents[{i}].{shortage.where}")


def _find_card(agent: AgentSpec, directory: Path) -> MethodCard | None:
    name = agent.start.python or ""
    for program in (name, find_bundled_agent(name) or "", *(agent.start.command or ())):
        # An argument may be too long for a file's name, which `Path.is_file` refuses.
        is_file = os.path.isfile(directory / program)  # noqa: PTH113
        if is_file and (card := find_card_beside(directory / program)) is not None:
            return card
    return None
