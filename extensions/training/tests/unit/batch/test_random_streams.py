"""Numbers that kernels draw are those of `gslcosim.base.rng`, to the last bit."""

import numba
import numpy as np
import pytest

from gslcosim.base.rng import stream
from gslcosim_training.batch.random_streams import (
    next_normal_inplace,
    next_poisson_inplace,
    seed_inplace,
)


@numba.njit
def normals(state, n):
    """Draw n numbers."""
    drawn = np.empty(n)
    for i in range(n):
        drawn[i] = next_normal_inplace(state)
    return drawn


@numba.njit
def hits(state, means):
    """Draw a number for each mean."""
    drawn = np.empty(len(means), np.int64)
    for i in range(len(means)):
        drawn[i] = next_poisson_inplace(state, means[i])
    return drawn


@pytest.mark.parametrize("seed", [0, 7, 2**31 - 1])
@pytest.mark.parametrize("name", ["x", "abc", "sensing.beetle.nose"])
def test_streams_begin_and_go_on_as_those_of_rng(seed, name):
    state = np.zeros(4, np.uint64)
    seed_inplace(state, seed, np.frombuffer(name.encode(), np.uint8))
    rng = stream(seed, name)
    # So many that the tails of the ziggurat are among them.
    assert np.array_equal(normals(state, 20_000), rng.standard_normal(20_000))


def test_hits_are_those_of_poisson():
    state = np.zeros(4, np.uint64)
    seed_inplace(state, 5, np.frombuffer(b"hits", np.uint8))
    rng = stream(5, "hits")
    means = np.array([0.0, 0.01, 3.0, 9.99, 10.0, 60.0, 5000.0] * 50)
    assert np.array_equal(hits(state, means), rng.poisson(means))
