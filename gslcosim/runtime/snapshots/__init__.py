"""Snapshots of a run: the state of all its participants at a tick, from which it goes on."""
