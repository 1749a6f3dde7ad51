"""The knowledge that a scenario grants to agents: the map of the room, and nominal figures of the plume."""

import math

import numpy as np

from gslcosim.contract.arrays import NumericArray
from gslcosim.contract.messages import KnownMap, NominalPlume
from gslcosim.environment.model import Cell, Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import FilamentsSpec
from gslcosim.scenario.models.scenario import AgentSpec


def map_for(agent: AgentSpec, environment: Environment) -> KnownMap | None:
    """Return the map that an agent is granted, or None where it is granted none.

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


def nominal_plume(scenario: Scenario) -> NominalPlume:
    """Return nominal figures of the plume: those of the first source, and the speed of the wind at the inlet.

    Q = rate ppm0 (2 pi)^(3/2) sigma0^3        [ppm m^3/s] = [1/s] [ppm] [m^3]

    Q is what the integral of the mixing ratio over all space gains a second; a filament with the mixing ratio ppm0 at
    its centre and the standard deviation sigma0 holds (2 pi)^(3/2) sigma0^3 ppm0.

    Held by:
        tests/unit/sensing/test_granted.py
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
