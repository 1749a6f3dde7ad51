"""Setup of a gas model: its steps in the ticks of a run, the registry of builders, and shared settings."""

from dataclasses import dataclass
from functools import singledispatch

from gslcosim.base.errors import ScenarioError
from gslcosim.base.gases import air_density_mol_m3
from gslcosim.base.ticks import NS_PER_S
from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.gas import GasSpec, SourceSpec
from gslcosim_services.fields.filament.plume import WindAt, filament_amount_mol
from gslcosim_services.fields.filament_field import MIN_READINGS_FOR_INDEX
from gslcosim_services.fields.gas_field import GasField, Visibility


@dataclass(frozen=True, kw_only=True)
class GasTiming:
    """Steps of the gas: several in a tick, or one every several ticks (between which the gas rests)."""

    step_s: float
    steps_per_tick: int
    ticks_per_step: int
    warm_up_steps: int

    def steps_at(self, tick: int) -> int:
        """Return how many steps bring the gas to the end of a tick; none at tick 0, which is the initial state."""
        is_due = tick > 0 and tick % self.ticks_per_step == 0
        return self.steps_per_tick if is_due else 0


def gas_timing(scenario: Scenario) -> GasTiming:
    """Return how a scenario's gas steps fit into its ticks.

    Raises:
        ScenarioError: the step is neither a whole fraction nor a whole multiple of the tick, or the warm-up is not a
            whole number of steps.
    """
    gas, tick_ns = scenario.gas, scenario.tick_ns
    step_ns = round(gas.step_s * NS_PER_S)
    if step_ns < 1 or (tick_ns % step_ns and step_ns % tick_ns):
        raise ScenarioError(
            f"gas.step_s: expected a whole fraction or a whole multiple of the tick of {tick_ns / NS_PER_S:g} s, "
            f"was {gas.step_s:g} s."
        )
    warm_up_ns = round(gas.warm_up_s * NS_PER_S)
    if warm_up_ns % step_ns:
        below = warm_up_ns // step_ns * step_ns / NS_PER_S
        raise ScenarioError(
            f"gas.warm_up_s: expected a whole number of gas steps of {gas.step_s:g} s, was {gas.warm_up_s:g} s. "
            f"Nearest: {below:g} s or {below + gas.step_s:g} s."
        )
    return GasTiming(
        step_s=step_ns / NS_PER_S,
        steps_per_tick=max(1, tick_ns // step_ns),
        ticks_per_step=max(1, step_ns // tick_ns),
        warm_up_steps=warm_up_ns // step_ns,
    )


@dataclass(frozen=True, kw_only=True)
class GasSetup:
    """Inputs of a builder of a gas field besides its block.

    Attributes:
        scenario: The whole scenario.
        environment: The room, with its wind.
        sight: Visibility of filaments; absent: hidden by the room's walls, up to the model's own cut-off.
        n_readings_per_step: How many readings a step will be asked for.
        wind_at: The wind at a time [s] in place of the room's, where a service changes it; see `FilamentPlume`.
    """

    scenario: Scenario
    environment: Environment
    sight: Visibility | None = None
    n_readings_per_step: int = MIN_READINGS_FOR_INDEX
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
def build_gas_field_from_block(block: GasSpec, setup: GasSetup) -> GasField:
    """Return the gas field of a gas model's block; it stands at time 0 with `setup.seed`.

    Each model, also one of another package, registers its builder by the type of its block.

    Raises:
        ScenarioError: no builder is registered for the block, or the builder refuses it.
    """
    del setup
    raise ScenarioError(
        f"gas.model: expected a builder for {type(block).__name__}, was none. "
        f"The package of {block.model} has to register it with gas_field_of_block."
    )


def gas_seed(scenario: Scenario, seed: int) -> int:
    """Return the seed of the gas in a run of a seed: `gas.seed` if the scenario has one, otherwise the run's."""
    return seed if scenario.gas.seed is None else scenario.gas.seed


def list_gas_names(gas: GasSpec) -> tuple[str, ...]:
    """Return the names of a scenario's gases, the one that is searched for first."""
    return tuple(dict.fromkeys([gas.gas, *(source.gas or gas.gas for source in gas.sources)]))


def mean_release_m3_s(source: SourceSpec, *, place: str = "release") -> float:
    """Return the mean release of pure gas of a source over long times [m3/s], at 298 K and 1 atm.

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
    filament_m3 = filament_amount_mol(source.ppm, source.sigma_m) / air_density_mol_m3()
    return share * source.filaments_per_s * filament_m3
