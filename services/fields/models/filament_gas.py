"""Gas of filaments: a plume from a scenario's sources and constants, live or from tape."""

from dataclasses import dataclass

import numpy as np

from gslcosim.base.errors import ScenarioError
from gslcosim.base.gases import air_density_mol_m3
from gslcosim.environment.model import AT_START, Closed, Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import SourceEventSpec
from gslcosim.scenario.models.gas import FilamentGasSpec, FilamentsSpec, SourceSpec, list_gases
from gslcosim_services.fields.filament.plume import (
    NEUTRAL,
    Buoyancy,
    FilamentPlume,
    GasSource,
    WindAt,
    filament_amount_mol,
    gaden_3_buoyancy,
    terminal_velocity_buoyancy,
)
from gslcosim_services.fields.filament.release import (
    ConstantRelease,
    IntermittentRelease,
    PoissonRelease,
    ReleasePlan,
    ScheduledRelease,
    SourceShape,
    VariableRelease,
)
from gslcosim_services.fields.filament_field import FilamentField, FilamentSource, PrefetchedPlume
from gslcosim_services.fields.gas_field import GasField, Visibility
from gslcosim_services.fields.gas_setup import (
    GasSetup,
    build_gas_field_from_block,
    gas_seed,
    gas_timing,
    list_gas_names,
)
from gslcosim_services.fields.mixing_ratio import CUTOFF_SIGMA, Walls
from gslcosim_services.fields.tape import MAX_SOURCES, CachedPlume
from gslcosim_services.fields.turbulence.air import (
    KEpsilonFields,
    TurbulentAir,
    build_turbulent_air,
    k_epsilon_from_intensity,
    mean_speed_m_s,
)
from gslcosim_services.fields.turbulence.point_turbulence import PointTurbulence
from gslcosim_services.fields.wall_images import WallImages

# GADEN 3 multiplies its noise by ten times the step: at its usual 0.1 s the configured value remains.
GADEN_3_NOISE_PER_S = 10.0
GADEN_3_CUTOFF_SIGMA = 3.0


@dataclass(frozen=True, kw_only=True)
class GasModel:
    """Gas model of a scenario: names of the gases, the plume, the cut-off of its readings, and its turbulence."""

    gases: tuple[str, ...]
    plume: FilamentPlume
    cutoff_sigma: float
    air: TurbulentAir | None = None


@build_gas_field_from_block.register
def _build_filament_field(block: FilamentGasSpec, setup: GasSetup) -> GasField:
    model = build_gas_model(setup.scenario, setup.environment, wind_at=setup.wind_at)
    wind = setup.environment.wind
    return FilamentField(
        _build_filament_source(block, model.plume, setup),
        model.gases,
        setup.environment.grid,
        sight=setup.sight or Visibility(walls=Walls.of(setup.environment), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=setup.n_readings_per_step,
        wind_at=setup.wind_at,
        later_sights={
            closed: Visibility(walls=Walls.of(room), cutoff_sigma=model.cutoff_sigma)
            for closed, room in setup.environment.by_doors().items()
            if closed != AT_START
        },
        images=build_wall_images(block, setup.environment),
        turbulence=build_point_turbulence(
            block,
            model,
            setup,
            wind_at=setup.wind_at or (lambda time_s: np.asarray(wind.velocity_m_s[wind.frame_at(time_s)])),
        ),
    )


def build_wall_images(block: FilamentsSpec, environment: Environment) -> dict[Closed, WallImages] | None:
    """Build the walls that reflect gas for each set of closed doors; None where walls cut filaments off."""
    if not block.wall_images:
        return None
    return {closed: WallImages.of(room) for closed, room in environment.by_doors().items()}


def build_point_turbulence(
    block: FilamentsSpec, model: "GasModel", setup: GasSetup, *, wind_at: WindAt
) -> PointTurbulence | None:
    """Build the turbulence of a gas at points, for instruments in a mean wind; None where the gas has none."""
    if block.eddies is None or model.air is None:
        return None
    return PointTurbulence(
        model.air,
        setup.environment.grid,
        inner_intensity=block.eddies.inner_intensity,
        wind_at=wind_at,
        seed=setup.seed,
    )


def build_air_of_gas(gas: FilamentsSpec, environment: Environment, *, speed_m_s: float | None) -> TurbulentAir | None:
    """Build the turbulence of a gas in its room; None where it has none.

    Args:
        gas: Its `turbulence`.
        speed_m_s: Mean speed of the gas's own wind, in air that goes on beyond the grid; absent: the room's wind.

    Raises:
        ScenarioError: the wind has no k and epsilon, or blows nowhere.
    """
    spec = gas.eddies
    if spec is None:
        return None
    if spec.kind == "wind":
        return _build_air_of_wind(environment, is_own_wind=speed_m_s is not None)
    speed = mean_speed_m_s(environment) if speed_m_s is None else speed_m_s
    if speed <= 0.0:
        raise ScenarioError(
            "gas.turbulence.kind: expected a wind that blows with kind: given, was still air. Take kind: none."
        )
    k, epsilon = k_epsilon_from_intensity(spec.intensity_frac * speed, spec.length_m)
    shape = environment.grid.shape
    return build_turbulent_air(
        environment,
        KEpsilonFields(k_m2_s2=np.full(shape, k), epsilon_m2_s3=np.full(shape, epsilon)),
        is_open=speed_m_s is not None,
    )


def _build_filament_source(block: FilamentGasSpec, plume: FilamentPlume, setup: GasSetup) -> FilamentSource:
    if block.tape:
        return build_cached_plume(setup.scenario, setup.environment)
    # Changes by events and participants are not known ahead.
    has_events = any(isinstance(event, SourceEventSpec) for event in setup.scenario.events)
    if setup.wind_at is not None or has_events or setup.scenario.driven_sources:
        return plume
    timing = gas_timing(setup.scenario)
    return PrefetchedPlume(plume, step_s=timing.step_s, steps_per_frame=timing.steps_per_tick)


def build_cached_plume(scenario: Scenario, environment: Environment) -> CachedPlume:
    """Build the gas of a scenario from tape, recorded at its first reset where there is none yet.

    Raises:
        ScenarioError: there are too many sources for a tape.
    """
    if len(scenario.gas.sources) > MAX_SOURCES:
        raise ScenarioError(
            f"gas.sources: expected at most {MAX_SOURCES} with tape: true, was {len(scenario.gas.sources)}."
        )

    def plume_of(seed: int) -> FilamentPlume:
        plume = build_gas_model(scenario, environment).plume
        plume.reset(seed)
        return plume

    return CachedPlume(plume_of, scenario, environment)


def build_gas_model(
    scenario: Scenario,
    environment: Environment,
    *,
    wind_at: WindAt | None = None,
    own_speed_m_s: float | None = None,
) -> GasModel:
    """Build the filaments of a scenario in its room; the gas that is searched for comes first.

    Args:
        wind_at: The wind at a time [s] in place of the room's; see `FilamentPlume`.
        own_speed_m_s: Mean speed of that wind, where the gas has its own and the air goes on beyond the grid.

    `compatibility: gaden_2` draws the same displacement in each step whatever its length and has no buoyancy;
    `gaden_3_buoyancy` scales it with the step's length, has its own buoyancy, and reads filaments up to 3 sigma away.

    Raises:
        ScenarioError: a model without filaments, unknown gas, source outside the air, gas step or warm-up that
            does not fit the ticks.
    """
    if not isinstance(scenario.gas, FilamentsSpec):
        raise ScenarioError(f"gas.model: expected a model that moves filaments, was {scenario.gas.model}.")
    gas, timing = scenario.gas, gas_timing(scenario)
    gases = list_gas_names(gas)
    air = build_air_of_gas(gas, environment, speed_m_s=own_speed_m_s)
    plume = FilamentPlume(
        environment,
        tuple(_build_source(source, gas, gases) for source in gas.sources),
        step_s=timing.step_s,
        growth_m2_s=gas.growth_m2_s,
        diffusivity_m2_s=gas.eddy_diffusivity_m2_s,
        noise_std_m=_noise_std_m(gas, timing.step_s),
        seed=gas_seed(scenario, scenario.seed),
        wind_at=wind_at,
        air=air,
    )
    cutoff_sigma = GADEN_3_CUTOFF_SIGMA if gas.compatibility == "gaden_3" else CUTOFF_SIGMA
    return GasModel(gases=gases, plume=plume, cutoff_sigma=cutoff_sigma, air=air)


def _build_air_of_wind(environment: Environment, *, is_own_wind: bool) -> TurbulentAir:
    k_epsilon = environment.wind.k_epsilon
    if k_epsilon is None or is_own_wind:
        raise ScenarioError(
            "gas.turbulence.kind: expected given, as the wind has no k and epsilon, was wind. Give intensity_frac and "
            "length_m, or let the built-in solver solve the wind."
        )
    return build_turbulent_air(environment, KEpsilonFields(k_m2_s2=k_epsilon[..., 0], epsilon_m2_s3=k_epsilon[..., 1]))


def _build_source(source: SourceSpec, gas: FilamentsSpec, gases: tuple[str, ...]) -> GasSource:
    return GasSource(
        position_world_m=source.position_m,
        release=_build_release(source),
        sigma_m=source.sigma_m,
        amount_mol=filament_amount_mol(source.ppm, source.sigma_m),
        gas_index=gases.index(source.gas or gas.gas),
        shape=SourceShape(kind=source.shape.kind, size_m=source.shape.size_m),
        buoyancy=_build_buoyancy(source, gas),
    )


def _build_release(source: SourceSpec) -> ReleasePlan:
    rate, spec = source.filaments_per_s, source.release
    plans: dict[str, ReleasePlan] = {
        "constant": ConstantRelease(filaments_per_s=rate),
        "poisson": PoissonRelease(filaments_per_s=rate),
        "variable": VariableRelease(filaments_per_s=rate, interval_s=spec.interval_s),
        "intermittent": IntermittentRelease(filaments_per_s=rate, on_s=spec.on_s, off_s=spec.off_s),
        "scheduled": ScheduledRelease(schedule=spec.schedule),
    }
    return plans[spec.kind]


def _build_buoyancy(source: SourceSpec, gas: FilamentsSpec) -> Buoyancy:
    specific_gravity = list_gases(gas.define)[source.gas or gas.gas].specific_gravity
    if gas.compatibility == "gaden_3":
        return gaden_3_buoyancy(specific_gravity, source.ppm, source.sigma_m)
    if gas.compatibility == "gaden_2" or gas.buoyancy == "none":
        return NEUTRAL
    volume_m3 = filament_amount_mol(source.ppm, source.sigma_m) / air_density_mol_m3()
    return terminal_velocity_buoyancy(specific_gravity, volume_m3)


def _noise_std_m(gas: FilamentsSpec, step_s: float) -> float | None:
    if gas.compatibility == "gaden_2":
        return gas.gaden_noise_std_m
    if gas.compatibility == "gaden_3":
        return gas.gaden_noise_std_m * GADEN_3_NOISE_PER_S * step_s
    return None
