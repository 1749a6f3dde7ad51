"""Scenario files: YAML read once into frozen models; all problems of a file in one error."""

from gslcosim.scenario.dumping import dump_resolved
from gslcosim.scenario.loading import LoadedScenario, load_scenario
from gslcosim.scenario.models.scenario import Scenario

__all__ = ["LoadedScenario", "Scenario", "dump_resolved", "load_scenario"]
