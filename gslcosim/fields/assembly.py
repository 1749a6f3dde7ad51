"""From a scenario to the sources and constants of the filament model."""

from dataclasses import dataclass

from gslcosim.environment.model import Environment
from gslcosim.fields.buoyancy import NEUTRAL, Buoyancy, gaden_3, terminal_velocity
from gslcosim.fields.concentration import CUTOFF_SIGMA, Walls
from gslcosim.fields.filament_field import READINGS_WORTH_AN_INDEX, FilamentField
from gslcosim.fields.filaments import FilamentPlume, GasSource, amount_of_filament_mol
from gslcosim.fields.gas_field import GasField, Sight
from gslcosim.fields.gases import air_density_mol_m3, gas_named
from gslcosim.fields.release import (
    ConstantRelease,
    IntermittentRelease,
    PoissonRelease,
    ReleasePlan,
    ScheduledRelease,
    VariableRelease,
)
from gslcosim.fields.source_shapes import SourceShape
from gslcosim.fields.timing import gas_timing
from gslcosim.scenario import Scenario
from gslcosim.scenario.gas_models import GasSpec, SourceSpec

# GADEN 3 multiplies its noise by ten times the step: at its usual 0.1 s the configured value remains.
GADEN_3_NOISE_PER_S = 10.0
GADEN_3_CUTOFF_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class GasModel:
    """What a scenario's gas is made of: names of the gases, the plume, and the cut-off of its readings."""

    gases: tuple[str, ...]
    plume: FilamentPlume
    cutoff_sigma: float


def gas_field_of(
    scenario: Scenario,
    environment: Environment,
    *,
    sight: Sight | None = None,
    n_readings_per_step: int = READINGS_WORTH_AN_INDEX,
) -> GasField:
    """Build the gas of a scenario in its room, whatever its model; it stands at time 0 with the scenario's seed.

    Args:
        scenario: Its `gas`.
        environment: Its room.
        sight: What is seen of filaments; absent: what the room's walls leave, up to the model's own cut-off.
        n_readings_per_step: How many readings a step will be asked for.

    Raises:
        ScenarioError: unknown gas, source outside the air, gas step or warm-up that does not fit the ticks.
    """
    model = gas_model_of(scenario, environment)
    return FilamentField(
        model.plume,
        model.gases,
        environment.grid,
        sight=sight or Sight(walls=Walls.of(environment), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=n_readings_per_step,
    )


def gas_model_of(scenario: Scenario, environment: Environment) -> GasModel:
    """Build the plume of a scenario in its room; the gas that is searched for comes first.

    `compatibility: gaden_2` draws the same displacement in each step whatever its length and knows no buoyancy;
    `gaden_3` scales it with the step's length, has its own buoyancy, and reads filaments up to 3 sigma away.

    Raises:
        ScenarioError: unknown gas, source outside the air, gas step or warm-up that does not fit the ticks.
    """
    gas, timing = scenario.gas, gas_timing(scenario)
    gases = tuple(dict.fromkeys([gas.gas, *(source.gas or gas.gas for source in gas.sources)]))
    for i, name in enumerate(gases):
        gas_named(name, place="gas.gas" if i == 0 else "gas.sources[].gas")
    plume = FilamentPlume(
        environment,
        tuple(_source(source, gas, gases) for source in gas.sources),
        step_s=timing.step_s,
        growth_m2_s=gas.growth_m2_s,
        diffusivity_m2_s=gas.eddy_diffusivity_m2_s,
        noise_std_m=_noise_std_m(gas, timing.step_s),
        seed=scenario.seed,
    )
    cutoff_sigma = GADEN_3_CUTOFF_SIGMA if gas.compatibility == "gaden_3" else CUTOFF_SIGMA
    return GasModel(gases=gases, plume=plume, cutoff_sigma=cutoff_sigma)


def _source(source: SourceSpec, gas: GasSpec, gases: tuple[str, ...]) -> GasSource:
    return GasSource(
        position_world_m=source.position_m,
        release=_release(source),
        sigma_m=source.sigma_m,
        amount_mol=amount_of_filament_mol(source.ppm, source.sigma_m),
        gas_index=gases.index(source.gas or gas.gas),
        shape=SourceShape(kind=source.shape.kind, size_m=source.shape.size_m),
        buoyancy=_buoyancy(source, gas),
    )


def _release(source: SourceSpec) -> ReleasePlan:
    rate, spec = source.filaments_per_s, source.release
    plans: dict[str, ReleasePlan] = {
        "constant": ConstantRelease(filaments_per_s=rate),
        "poisson": PoissonRelease(filaments_per_s=rate),
        "variable": VariableRelease(filaments_per_s=rate, interval_s=spec.interval_s),
        "intermittent": IntermittentRelease(filaments_per_s=rate, on_s=spec.on_s, off_s=spec.off_s),
        "scheduled": ScheduledRelease(schedule=spec.schedule),
    }
    return plans[spec.kind]


def _buoyancy(source: SourceSpec, gas: GasSpec) -> Buoyancy:
    specific_gravity = gas_named(source.gas or gas.gas).specific_gravity
    if gas.compatibility == "gaden_3":
        return gaden_3(specific_gravity, source.ppm, source.sigma_m)
    if gas.compatibility == "gaden_2" or gas.buoyancy == "none":
        return NEUTRAL
    volume_m3 = amount_of_filament_mol(source.ppm, source.sigma_m) / air_density_mol_m3()
    return terminal_velocity(specific_gravity, volume_m3)


def _noise_std_m(gas: GasSpec, step_s: float) -> float | None:
    if gas.compatibility == "gaden_2":
        return gas.gaden_noise_std_m
    if gas.compatibility == "gaden_3":
        return gas.gaden_noise_std_m * GADEN_3_NOISE_PER_S * step_s
    return None
