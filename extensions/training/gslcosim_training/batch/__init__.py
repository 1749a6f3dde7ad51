"""Thousands of searches at a time, stepped by compiled code: `BatchSearchEnv`."""

from gslcosim_training.batch.batch_env import BatchSearchEnv

__all__ = ["BatchSearchEnv"]
