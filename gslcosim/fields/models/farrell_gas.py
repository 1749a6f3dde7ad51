"""Gas of filaments in Farrell's open field, from its block."""

from gslcosim.fields.gas_field import GasField, Sight
from gslcosim.fields.gas_setup import GasSetup, gas_field_of_block, wind_at_first_source_m_s
from gslcosim.fields.models.farrell import FarrellWind, Gusts, OpenFieldPlume, open_field
from gslcosim.fields.models.filament_gas import gas_model_of
from gslcosim.fields.reading.concentration import Walls
from gslcosim.fields.reading.filament_field import FilamentField
from gslcosim.scenario.models.gas import FarrellGasSpec


@gas_field_of_block.register
def _farrell_field(block: FarrellGasSpec, setup: GasSetup) -> GasField:
    scenario, environment, spec = setup.scenario, setup.environment, block.farrell
    wind = FarrellWind(
        environment.grid,
        mean_m_s=spec.wind_m_s or wind_at_first_source_m_s(scenario, environment),
        gusts=Gusts(std_m_s=spec.gust_std_m_s, period_s=spec.gust_period_s, damping=spec.gust_damping),
        viscosity_m2_s=spec.eddy_viscosity_m2_s,
        n_nodes=spec.n_nodes,
    )
    field_of_air = open_field(environment)
    model = gas_model_of(scenario, field_of_air, wind_at=wind.at)
    source = OpenFieldPlume(model.plume, wind)
    source.reset(setup.seed)
    return FilamentField(
        source,
        model.gases,
        environment.grid,
        sight=setup.sight or Sight(walls=Walls.of(field_of_air), cutoff_sigma=model.cutoff_sigma),
        n_readings_per_step=setup.n_readings_per_step,
        wind_at=wind.at,
    )
