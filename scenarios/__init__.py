"""Bundled scenarios and suites, found by name."""
