"""Builder of a scenario's gas: the model is found by the type of the scenario's block."""

from gslcosim.environment.model import Environment
from gslcosim.scenario import Scenario
from gslcosim_services.fields.filament.plume import WindAt
from gslcosim_services.fields.filament_field import MIN_READINGS_FOR_INDEX
from gslcosim_services.fields.gas_field import GasField, Visibility
from gslcosim_services.fields.gas_setup import GasSetup, build_gas_field_from_block
from gslcosim_services.fields.models import filament_gas

BUILT_IN_MODELS = (filament_gas,)
"""The modules that register the builders of gslcosim's own gas models."""


def build_gas_field(
    scenario: Scenario,
    environment: Environment,
    *,
    sight: Visibility | None = None,
    n_readings_per_step: int = MIN_READINGS_FOR_INDEX,
    wind_at: WindAt | None = None,
) -> GasField:
    """Build the gas of a scenario in its room, whatever its model; it stands at time 0 with the scenario's seed.

    Args:
        sight: Visibility of filaments; absent: hidden by the room's walls, up to the model's own cut-off.
        n_readings_per_step: Number of readings in a step.
        wind_at: The wind at a time [s] in place of the room's, where a service changes it.
    """
    setup = GasSetup(
        scenario=scenario,
        environment=environment,
        sight=sight,
        n_readings_per_step=n_readings_per_step,
        wind_at=wind_at,
    )
    return build_gas_field_from_block(scenario.gas, setup)
