"""Frozen models of a scenario file, one module a part; every field with unit, default and range.

`scenario.Scenario` is the whole; from outside use `gslcosim.scenario`.
"""
