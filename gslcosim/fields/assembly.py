"""From a scenario to its gas: which model, with which sources and constants."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gslcosim.environment.model import Environment
from gslcosim.environment.wind_kernels import trilinear_wind_at_points
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
from gslcosim.fields.gases import air_density_mol_m3, gas_named
from gslcosim.fields.models.farrell import FarrellWind, Gusts, OpenFieldPlume, open_field
from gslcosim.fields.models.formula_fields import FormulaField, FormulaPlume, PlaybackField
from gslcosim.fields.models.gaussian_plume import GaussianPlume, MeanderingPlume
from gslcosim.fields.reading.concentration import CUTOFF_SIGMA, Walls
from gslcosim.fields.reading.filament_field import READINGS_WORTH_AN_INDEX, FilamentField
from gslcosim.fields.stored.frame import GasFrame
from gslcosim.fields.stored.movie import MOVIE_SUFFIX, GasMovie
from gslcosim.fields.stored.playback import GasPlayback, usual_period_s
from gslcosim.fields.stored.tape import MOST_SOURCES, TapedPlume
from gslcosim.fields.timing import gas_timing
from gslcosim.quantities import Vec3
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import GasSpec, PlaybackSpec, SourceSpec

# GADEN 3 multiplies its noise by ten times the step: at its usual 0.1 s the configured value remains.
GADEN_3_NOISE_PER_S = 10.0
GADEN_3_CUTOFF_SIGMA = 3.0

# Heads of stored frames name a source to a few decimetres (GSL-Bench's 004 and 006 are 0.2 m off).
_SOURCE_TOLERANCE_M = 1.0


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
    chosen = scenario.gas.model
    if chosen == "farrell":
        return _farrell_field(scenario, environment, sight, n_readings_per_step)
    if chosen == "playback":
        return _playback_field(scenario, environment, sight)
    if chosen != "filament":
        return _formula_field(scenario, environment)
    model = gas_model_of(scenario, environment)
    return FilamentField(
        _taped(scenario, environment) if scenario.gas.tape else model.plume,
        model.gases,
        environment.grid,
        sight=sight or Sight(walls=Walls.of(environment), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=n_readings_per_step,
    )


def _taped(scenario: Scenario, environment: Environment) -> TapedPlume:
    if len(scenario.gas.sources) > MOST_SOURCES:
        raise ScenarioError(
            f"gas.sources: expected at most {MOST_SOURCES} with tape: true, was {len(scenario.gas.sources)}."
        )

    def plume_of(seed: int) -> FilamentPlume:
        plume = gas_model_of(scenario, environment).plume
        plume.reset(seed)
        return plume

    return TapedPlume(plume_of, scenario, environment)


def gas_seed(scenario: Scenario, seed: int) -> int:
    """Return the seed of the gas in a run of a seed: `gas.seed` if the scenario has one, otherwise the run's."""
    return seed if scenario.gas.seed is None else scenario.gas.seed


def gas_model_of(scenario: Scenario, environment: Environment, *, wind_at: WindAt | None = None) -> GasModel:
    """Build the filaments of a scenario in its room; the gas that is searched for comes first.

    Args:
        scenario: Its `gas`.
        environment: Its room.
        wind_at: The wind at a time [s] in place of the room's; see `FilamentPlume`.

    `compatibility: gaden_2` draws the same displacement in each step whatever its length and knows no buoyancy;
    `gaden_3` scales it with the step's length, has its own buoyancy, and reads filaments up to 3 sigma away.

    Raises:
        ScenarioError: unknown gas, source outside the air, gas step or warm-up that does not fit the ticks.
    """
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


def gases_in(gas: GasSpec) -> tuple[str, ...]:
    """Return the names of a scenario's gases, the one that is searched for first.

    Raises:
        ScenarioError: there is no such gas.
    """
    gases = tuple(dict.fromkeys([gas.gas, *(source.gas or gas.gas for source in gas.sources)]))
    for i, name in enumerate(gases):
        gas_named(name, place="gas.gas" if i == 0 else "gas.sources[].gas", definitions=gas.define)
    return gases


def _farrell_field(
    scenario: Scenario, environment: Environment, sight: Sight | None, n_readings_per_step: int
) -> GasField:
    spec = scenario.gas.farrell
    wind = FarrellWind(
        environment.grid,
        mean_m_s=spec.wind_m_s or _wind_at_first_source_m_s(scenario, environment),
        gusts=Gusts(std_m_s=spec.gust_std_m_s, period_s=spec.gust_period_s, damping=spec.gust_damping),
        viscosity_m2_s=spec.eddy_viscosity_m2_s,
        n_nodes=spec.n_nodes,
    )
    field_of_air = open_field(environment)
    model = gas_model_of(scenario, field_of_air, wind_at=wind.at)
    source = OpenFieldPlume(model.plume, wind)
    source.reset(gas_seed(scenario, scenario.seed))
    return FilamentField(
        source,
        model.gases,
        environment.grid,
        sight=sight or Sight(walls=Walls.of(field_of_air), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=n_readings_per_step,
        wind_at=wind.at,
    )


def _playback_field(scenario: Scenario, environment: Environment, sight: Sight | None) -> GasField:
    gas, spec = scenario.gas, scenario.gas.playback
    assert spec is not None, "a GasSpec has it with this model"
    path = Path(spec.folder)
    stored = GasMovie(path, is_looping=spec.loop) if path.suffix == MOVIE_SUFFIX else _frames(path, spec)
    first = stored.frame(stored.numbers[0]) if isinstance(stored, GasPlayback) else None
    if first is not None:
        _check_frame(first, gas)
    gases = gases_in(gas)
    return PlaybackField(
        stored,
        gas.gas,
        environment.grid,
        step_s=gas_timing(scenario).step_s,
        sight=sight or Sight(walls=Walls.of(environment)),
        other_gases=gases[1:],
    )


def _frames(folder: Path, spec: PlaybackSpec) -> GasPlayback:
    return GasPlayback(folder, period_s=spec.period_s or usual_period_s(folder), is_looping=spec.loop)


# The run is judged by the scenario's source, and the sensors respond to the scenario's gas.
def _check_frame(frame: GasFrame, gas: GasSpec) -> None:
    if frame.gas is not None and frame.gas != gas.gas:
        raise ScenarioError(f"gas.gas: expected {frame.gas}, the gas of the stored frames, was {gas.gas}.")
    place_m = frame.source_position_m
    if place_m is None:
        return
    gap_m = min(math.dist(place_m, source.position_m) for source in gas.sources)
    if gap_m > _SOURCE_TOLERANCE_M:
        raise ScenarioError(
            f"gas.sources: expected one at {place_m} m, where the stored frames have theirs; the nearest is "
            f"{gap_m:.3g} m away."
        )


def _formula_field(scenario: Scenario, environment: Environment) -> GasField:
    gas, spec = scenario.gas, scenario.gas.plume
    gases = gases_in(gas)
    wind_m_s = spec.wind_m_s or _wind_at_first_source_m_s(scenario, environment)
    if not (wind_m_s[0] or wind_m_s[1]):
        raise ScenarioError("gas.plume.wind_m_s: expected a horizontal wind, was calm air. Give one for the plume.")
    means = [
        GaussianPlume(
            position_world_m=source.position_m,
            release_m3_s=release_m3_s(source, place=f"gas.sources[{i}].release"),
            wind_world_m_s=wind_m_s,
            stability=spec.stability,
            has_ground=spec.has_ground,
        )
        for i, source in enumerate(gas.sources)
    ]
    columns = [gases.index(source.gas or gas.gas) for source in gas.sources]

    def steady(_seed: int) -> list[FormulaPlume]:
        return [
            FormulaPlume(
                gas_index=column,
                mixing_ratio_ppm_at=lambda points, _time_s, mean=mean: mean.mixing_ratio_ppm_at(points),
            )
            for column, mean in zip(columns, means, strict=True)
        ]

    def meandering(seed: int) -> list[FormulaPlume]:
        return [
            FormulaPlume(
                gas_index=column,
                mixing_ratio_ppm_at=MeanderingPlume.seeded(
                    mean,
                    instantaneous_frac=spec.instantaneous_frac,
                    correlation_s=spec.meander_s,
                    seed=seed,
                    name=str(i),
                ).mixing_ratio_ppm_at,
            )
            for i, (column, mean) in enumerate(zip(columns, means, strict=True))
        ]

    return FormulaField(
        steady if gas.model == "gaussian_plume" else meandering,
        gases,
        step_s=gas_timing(scenario).step_s,
        seed=gas_seed(scenario, scenario.seed),
    )


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
def _wind_at_first_source_m_s(scenario: Scenario, environment: Environment) -> Vec3:
    grid = environment.grid
    place = np.array([scenario.gas.sources[0].position_m], np.float64)
    frames = environment.wind.velocity_m_s
    winds = [trilinear_wind_at_points(frame, grid.origin_m, grid.cell_m, place)[0] for frame in frames]
    x, y, _ = np.mean(winds, axis=0).tolist()
    return (x, y, 0.0)


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
    specific_gravity = gas_named(source.gas or gas.gas, definitions=gas.define).specific_gravity
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
