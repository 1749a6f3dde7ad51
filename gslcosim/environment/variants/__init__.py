"""Variants of an environment during a run: doors that open and close, and winds that events bring."""
