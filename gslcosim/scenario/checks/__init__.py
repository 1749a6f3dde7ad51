"""Checks of the files that a user writes: one registry for validate, up, bench and train."""
