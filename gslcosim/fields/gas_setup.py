"""What the builders of gas fields share: the registry of builders by block, and what a scenario says to all."""

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from gslcosim.environment.model import Environment
from gslcosim.environment.wind_kernels import trilinear_wind_at_points
from gslcosim.errors import ScenarioError
from gslcosim.fields.filament.plume import WindAt, amount_of_filament_mol
from gslcosim.fields.gas_field import GasField, Sight
from gslcosim.fields.gases import air_density_mol_m3, gas_named
from gslcosim.fields.reading.filament_field import READINGS_WORTH_AN_INDEX
from gslcosim.fields.timing import gas_timing
from gslcosim.quantities import Vec3
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import GasSpec, SourceSpec


@dataclass(frozen=True, kw_only=True)
class GasSetup:
    """What a builder of a gas field has besides its block.

    Attributes:
        scenario: All that the scenario says.
        environment: The room, with its wind.
        sight: What is seen of filaments; absent: what the room's walls leave, up to the model's own cut-off.
        n_readings_per_step: How many readings a step will be asked for.
        wind_at: The wind at a time [s] in place of the room's, where a service changes it; see `FilamentPlume`.
    """

    scenario: Scenario
    environment: Environment
    sight: Sight | None = None
    n_readings_per_step: int = READINGS_WORTH_AN_INDEX
    wind_at: WindAt | None = None

    @property
    def step_s(self) -> float:
        """Length of a step of the gas [s]."""
        return gas_timing(self.scenario).step_s

    @property
    def seed(self) -> int:
        """Seed of the gas until the field is reset."""
        return gas_seed(self.scenario, self.scenario.seed)


@singledispatch
def gas_field_of_block(block: GasSpec, setup: GasSetup) -> GasField:
    """Return the gas field of a gas model's block; it stands at time 0 with `setup.seed`.

    Each model registers its builder by the type of its block, and so does a package that brings one.

    Raises:
        ScenarioError: nobody has registered a builder for the block, or the builder refuses it.
    """
    del setup
    raise ScenarioError(
        f"gas.model: expected a builder for {type(block).__name__}, was none. "
        f"The package of {block.model} has to register it with gas_field_of_block."
    )


def gas_seed(scenario: Scenario, seed: int) -> int:
    """Return the seed of the gas in a run of a seed: `gas.seed` if the scenario has one, otherwise the run's."""
    return seed if scenario.gas.seed is None else scenario.gas.seed


def gases_in(gas: GasSpec) -> tuple[str, ...]:
    """Return the names of a scenario's gases, the one that is searched for first.

    Raises:
        ScenarioError: there is no such gas.
    """
    gases = tuple(dict.fromkeys([gas.gas, *(source.gas or gas.gas for source in gas.sources)]))
    for i, name in enumerate(gases):
        gas_named(name, place="gas.gas" if i == 0 else "gas.sources[].gas", definitions=gas.define)
    return gases


def release_m3_s(source: SourceSpec, *, place: str = "release") -> float:
    """Return how much pure gas a source releases in the mean over long times [m3/s], at 298 K and 1 atm.

    Q = rate N / n_air
    [m3/s] = [1/s] [mol] / [mol/m3]

    Raises:
        ScenarioError: the rate follows a schedule, which has no mean unless all its rates are 0.
    """
    spec = source.release
    if spec.kind == "scheduled" and not any(rate for _, rate in spec.schedule):
        return 0.0
    if spec.kind == "scheduled":
        raise ScenarioError(f"{place}: expected a release that goes on for ever with this model, was scheduled.")
    share = {"variable": 0.5, "intermittent": spec.on_s / (spec.on_s + spec.off_s)}.get(spec.kind, 1.0)
    filament_m3 = amount_of_filament_mol(source.ppm, source.sigma_m) / air_density_mol_m3()
    return share * source.filaments_per_s * filament_m3


# Horizontal, and the mean over the frames of the wind.
def wind_at_first_source_m_s(scenario: Scenario, environment: Environment) -> Vec3:
    """Return the room's horizontal wind [m/s] at the first source."""
    grid = environment.grid
    place = np.array([scenario.gas.sources[0].position_m], np.float64)
    frames = environment.wind.velocity_m_s
    winds = [trilinear_wind_at_points(frame, grid.origin_m, grid.cell_m, place)[0] for frame in frames]
    x, y, _ = np.mean(winds, axis=0).tolist()
    return (x, y, 0.0)
