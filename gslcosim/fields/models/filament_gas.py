"""Gas of filaments: from a scenario's sources and constants to a plume, and from its block to a field."""

from dataclasses import dataclass

from gslcosim.environment.model import AT_START, Environment
from gslcosim.errors import ScenarioError
from gslcosim.fields.filament.buoyancy import NEUTRAL, Buoyancy, gaden_3, terminal_velocity
from gslcosim.fields.filament.plume import FilamentPlume, GasSource, WindAt, amount_of_filament_mol
from gslcosim.fields.filament.release import (
    ConstantRelease,
    IntermittentRelease,
    PoissonRelease,
    ReleasePlan,
    ScheduledRelease,
    VariableRelease,
)
from gslcosim.fields.filament.source_shapes import SourceShape
from gslcosim.fields.gas_field import GasField, Sight
from gslcosim.fields.gas_setup import GasSetup, gas_field_of_block, gas_seed, gases_in
from gslcosim.fields.gases import air_density_mol_m3, gas_named
from gslcosim.fields.reading.ahead import PlumeAhead
from gslcosim.fields.reading.concentration import CUTOFF_SIGMA, Walls
from gslcosim.fields.reading.filament_field import FilamentField, FilamentSource
from gslcosim.fields.stored.tape import MOST_SOURCES, TapedPlume
from gslcosim.fields.timing import gas_timing
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.event_kinds import SourceEventSpec
from gslcosim.scenario.models.gas import FilamentGasSpec, FilamentsSpec, SourceSpec

# GADEN 3 multiplies its noise by ten times the step: at its usual 0.1 s the configured value remains.
GADEN_3_NOISE_PER_S = 10.0
GADEN_3_CUTOFF_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class GasModel:
    """What a scenario's gas is made of: names of the gases, the plume, and the cut-off of its readings."""

    gases: tuple[str, ...]
    plume: FilamentPlume
    cutoff_sigma: float


@gas_field_of_block.register
def _filament_field(block: FilamentGasSpec, setup: GasSetup) -> GasField:
    model = gas_model_of(setup.scenario, setup.environment, wind_at=setup.wind_at)
    return FilamentField(
        _source_of_filaments(block, model.plume, setup),
        model.gases,
        setup.environment.grid,
        sight=setup.sight or Sight(walls=Walls.of(setup.environment), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=setup.n_readings_per_step,
        wind_at=setup.wind_at,
        later_sights={
            closed: Sight(walls=Walls.of(room), cutoff_sigma=model.cutoff_sigma)
            for closed, room in setup.environment.by_doors().items()
            if closed != AT_START
        },
    )


def _source_of_filaments(block: FilamentGasSpec, plume: FilamentPlume, setup: GasSetup) -> FilamentSource:
    if block.tape:
        return taped_plume(setup.scenario, setup.environment)
    # What events change is not known ahead.
    if setup.wind_at is not None or any(isinstance(event, SourceEventSpec) for event in setup.scenario.events):
        return plume
    timing = gas_timing(setup.scenario)
    return PlumeAhead(plume, step_s=timing.step_s, steps_per_frame=timing.steps_per_tick)


def taped_plume(scenario: Scenario, environment: Environment) -> TapedPlume:
    """Return the gas of a scenario from tape, recorded at its first reset where there is none yet.

    Raises:
        ScenarioError: there are too many sources for a tape.
    """
    if len(scenario.gas.sources) > MOST_SOURCES:
        raise ScenarioError(
            f"gas.sources: expected at most {MOST_SOURCES} with tape: true, was {len(scenario.gas.sources)}."
        )

    def plume_of(seed: int) -> FilamentPlume:
        plume = gas_model_of(scenario, environment).plume
        plume.reset(seed)
        return plume

    return TapedPlume(plume_of, scenario, environment)


def gas_model_of(scenario: Scenario, environment: Environment, *, wind_at: WindAt | None = None) -> GasModel:
    """Build the filaments of a scenario in its room; the gas that is searched for comes first.

    Args:
        scenario: Its `gas`.
        environment: Its room.
        wind_at: The wind at a time [s] in place of the room's; see `FilamentPlume`.

    `compatibility: gaden_2` draws the same displacement in each step whatever its length and knows no buoyancy;
    `gaden_3` scales it with the step's length, has its own buoyancy, and reads filaments up to 3 sigma away.

    Raises:
        ScenarioError: a model without filaments, unknown gas, source outside the air, gas step or warm-up that
            does not fit the ticks.
    """
    if not isinstance(scenario.gas, FilamentsSpec):
        raise ScenarioError(f"gas.model: expected a model that moves filaments, was {scenario.gas.model}.")
    gas, timing = scenario.gas, gas_timing(scenario)
    gases = gases_in(gas)
    plume = FilamentPlume(
        environment,
        tuple(_source(source, gas, gases) for source in gas.sources),
        step_s=timing.step_s,
        growth_m2_s=gas.growth_m2_s,
        diffusivity_m2_s=gas.eddy_diffusivity_m2_s,
        noise_std_m=_noise_std_m(gas, timing.step_s),
        seed=gas_seed(scenario, scenario.seed),
        wind_at=wind_at,
    )
    cutoff_sigma = GADEN_3_CUTOFF_SIGMA if gas.compatibility == "gaden_3" else CUTOFF_SIGMA
    return GasModel(gases=gases, plume=plume, cutoff_sigma=cutoff_sigma)


def _source(source: SourceSpec, gas: FilamentsSpec, gases: tuple[str, ...]) -> GasSource:
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


def _buoyancy(source: SourceSpec, gas: FilamentsSpec) -> Buoyancy:
    specific_gravity = gas_named(source.gas or gas.gas, definitions=gas.define).specific_gravity
    if gas.compatibility == "gaden_3":
        return gaden_3(specific_gravity, source.ppm, source.sigma_m)
    if gas.compatibility == "gaden_2" or gas.buoyancy == "none":
        return NEUTRAL
    volume_m3 = amount_of_filament_mol(source.ppm, source.sigma_m) / air_density_mol_m3()
    return terminal_velocity(specific_gravity, volume_m3)


def _noise_std_m(gas: FilamentsSpec, step_s: float) -> float | None:
    if gas.compatibility == "gaden_2":
        return gas.gaden_noise_std_m
    if gas.compatibility == "gaden_3":
        return gas.gaden_noise_std_m * GADEN_3_NOISE_PER_S * step_s
    return None
