"""Checks of a scenario beyond its models: rules between its parts, events and programs."""
