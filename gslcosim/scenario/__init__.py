"""Scenario files: YAML read once into frozen models; all problems of a file in one error."""

from gslcosim.scenario.loader import LoadedScenario, load_scenario
from gslcosim.scenario.models.scenario import Scenario
from gslcosim.scenario.serialization import dump_resolved

__all__ = ["LoadedScenario", "Scenario", "dump_resolved", "load_scenario"]
