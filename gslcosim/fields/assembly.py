"""From a scenario to its gas: each model's builder is found by the type of the scenario's block."""

from gslcosim.environment.model import Environment
from gslcosim.fields.filament.plume import WindAt
from gslcosim.fields.gas_field import GasField, Sight
from gslcosim.fields.gas_setup import GasSetup, gas_field_of_block
from gslcosim.fields.models import farrell_gas, filament_gas, playback_gas, plume_gas
from gslcosim.fields.reading.filament_field import READINGS_WORTH_AN_INDEX
from gslcosim.scenario import Scenario

OWN_MODELS = (filament_gas, plume_gas, farrell_gas, playback_gas)
"""The modules that register the builders of gslcosim's own gas models."""


def gas_field_of(
    scenario: Scenario,
    environment: Environment,
    *,
    sight: Sight | None = None,
    n_readings_per_step: int = READINGS_WORTH_AN_INDEX,
    wind_at: WindAt | None = None,
) -> GasField:
    """Build the gas of a scenario in its room, whatever its model; it stands at time 0 with the scenario's seed.

    Args:
        scenario: Its `gas`.
        environment: Its room.
        sight: What is seen of filaments; absent: what the room's walls leave, up to the model's own cut-off.
        n_readings_per_step: How many readings a step will be asked for.
        wind_at: The wind at a time [s] in place of the room's, where a service changes it.

    Raises:
        ScenarioError: unknown gas, source outside the air, gas step or warm-up that does not fit the ticks.
    """
    setup = GasSetup(
        scenario=scenario,
        environment=environment,
        sight=sight,
        n_readings_per_step=n_readings_per_step,
        wind_at=wind_at,
    )
    return gas_field_of_block(scenario.gas, setup)
