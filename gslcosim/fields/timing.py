"""How the gas's own steps fit into the ticks of a run."""

from dataclasses import dataclass

from gslcosim.errors import ScenarioError
from gslcosim.scenario import Scenario
from gslcosim.ticks import NS_PER_S


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
