"""Families of cases: files that say what varies from case to case, and which seeds are for training and which not."""

from gslcosim.training.families.family import Family, bundled_families, load_family

__all__ = ["Family", "bundled_families", "load_family"]
