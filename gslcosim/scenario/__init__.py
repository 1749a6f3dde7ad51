"""Scenario files: YAML read once into frozen models; all problems of a file in one error."""

from gslcosim.scenario.models import Scenario

__all__ = ["Scenario"]
