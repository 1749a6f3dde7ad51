"""Execution of trials: workers on this machine or a cluster, and the order of the work."""
