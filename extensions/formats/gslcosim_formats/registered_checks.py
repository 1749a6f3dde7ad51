"""Checks of scenarios that this package registers."""

from gslcosim.scenario.checks.registry import Check

CHECKS = (
    Check(
        name="stored gas",
        of="scenario",
        subject="room",
        finder="gslcosim_formats.stored_gas.model:find_stored_gas_problems",
        is_needed=lambda scenario: scenario.gas.stored_folder is not None,
    ),
)
