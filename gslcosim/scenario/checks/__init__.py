"""Checks of the files that a user writes: one registry, which validate, up, bench and train run alike."""
