"""Numbers that kernels draw are those of numpy's generators, to the last bit."""

import numba
import numpy as np
import pytest

from gslcosim.base.rng import stream
from gslcosim_training.batch.pcg64 import (
    next_normal_inplace,
    next_poisson_inplace,
    next_uniform_inplace,
    scrambled,
    seed_inplace,
)


@numba.njit
def normals(state, n):
    """Draw n numbers."""
    drawn = np.empty(n)
    for i in range(n):
        drawn[i] = next_normal_inplace(state)
    return drawn


@pytest.mark.parametrize("seed", [0, 7, 2**31 - 1])
@pytest.mark.parametrize("name", ["x", "abc", "sensing.beetle.nose"])
def test_streams_begin_and_go_on_as_those_of_rng(seed, name):
    state = np.zeros(4, np.uint64)
    seed_inplace(state, seed, np.frombuffer(name.encode(), np.uint8))
    rng = stream(seed, name)
    # So many that the tails of the ziggurat are among them.
    assert np.array_equal(normals(state, 20_000), rng.standard_normal(20_000))
    assert next_uniform_inplace(state) == rng.random()


def test_hits_are_those_of_poisson():
    state = np.zeros(4, np.uint64)
    seed_inplace(state, 5, np.frombuffer(b"hits", np.uint8))
    rng = stream(5, "hits")
    for mean in [0.0, 0.01, 3.0, 9.99, 10.0, 60.0, 5000.0] * 50:
        assert next_poisson_inplace(state, mean) == rng.poisson(mean)


def test_what_a_search_draws_depends_on_seed_search_and_number_of_its_resets():
    drawn = {int(scrambled(seed, i, n)) for seed in range(5) for i in range(20) for n in range(10)}
    assert len(drawn) == 1000
    assert int(scrambled(3, 4, 5)) == int(scrambled(3, 4, 5))
