"""Estimation from sensors that stand: how they respond to a source, backgrounds, events, and the source's terms."""
