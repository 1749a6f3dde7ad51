"""Evolution: costs fall, and equal costs make equal generations, whatever else is drawn."""

import numpy as np
import pytest

from gslcosim.base.errors import UsageError
from gslcosim_training.trainers.evolution import Evolution


def evolve(evolution, n):
    for _ in range(n):
        asked = evolution.ask()
        evolution.tell(((asked - 1.0) ** 2).sum(axis=1))
    return evolution


def begun(seed=1):
    return Evolution(4, population=8, spread=0.5, seed=seed)


def test_it_finds_where_costs_are_low():
    np.testing.assert_allclose(evolve(begun(), 60).centre, 1.0, atol=0.05)


def test_resumed_it_goes_on_to_the_same_bits():
    whole, half = evolve(begun(), 9), evolve(begun(), 4)
    again = begun()
    again.resume(half.state())
    assert np.array_equal(evolve(again, 5).centre, whole.centre)
    assert not np.array_equal(evolve(begun(seed=2), 9).centre, whole.centre)


def test_the_global_random_state_is_left_alone():
    np.random.seed(3)  # noqa: NPY002 - what is tested
    expected = np.random.rand()  # noqa: NPY002
    np.random.seed(3)  # noqa: NPY002
    first = evolve(begun(), 3).centre
    assert np.random.rand() == expected  # noqa: NPY002
    assert np.array_equal(evolve(begun(), 3).centre, first)


def test_a_state_of_another_population_is_refused():
    with pytest.raises(UsageError, match="checkpoint: told: expected an array of shape"):
        begun().resume({"told": np.zeros((2, 5))})
