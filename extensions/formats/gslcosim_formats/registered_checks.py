"""Checks of scenarios that this package registers."""

from gslcosim.scenario.checks.registry import Check
from gslcosim_formats.heat.keys import AIR, HEAT

CHECKS = (
    Check(
        name="heat",
        of="scenario",
        subject="room",
        finder="gslcosim_formats.heat.sources:find_heat_problems",
        is_needed=lambda scenario: (HEAT.get(scenario.environment), AIR.get(scenario.environment)) != (None, None),
    ),
    Check(
        name="stored gas",
        of="scenario",
        subject="room",
        finder="gslcosim_formats.stored_gas.model:find_stored_gas_problems",
        is_needed=lambda scenario: scenario.gas.stored_folder is not None,
    ),
    Check(
        name="gusts",
        of="scenario",
        subject="room",
        finder="gslcosim_formats.farrell:find_gust_warnings",
        is_needed=lambda scenario: scenario.gas.model == "farrell",
        is_warning=True,
    ),
)
