"""Checks of scenarios that this package registers."""

from gslcosim.scenario.checks.registry import Check
from gslcosim.scenario.models.scenario import Scenario
from gslcosim_fmi.scenario_keys import UNIT_START


def _has_units(scenario: Scenario) -> bool:
    return any(UNIT_START.get(own.start) is not None for own in scenario.participants)


CHECKS = (
    Check(
        name="FMUs",
        of="scenario",
        subject="services",
        finder="gslcosim_fmi.checks:find_fmu_problems",
        is_needed=_has_units,
    ),
    Check(
        name="states of FMUs",
        of="scenario",
        subject="services",
        finder="gslcosim_fmi.checks:find_fmu_warnings",
        is_needed=lambda scenario: scenario.snapshots is not None and _has_units(scenario),
        is_warning=True,
    ),
)
