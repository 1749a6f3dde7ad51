"""Compiled code calls the loops that numpy runs, so both have the same bits."""

import numba
import numpy as np

from gslcosim_training.batch.plume_kernels import numpy_exp, numpy_power


@numba.njit
def each(x, y):
    """Call both loops for each number."""
    result = np.empty((2, len(x)))
    for i in range(len(x)):
        result[0, i] = numpy_exp(x[i])
        result[1, i] = numpy_power(-x[i], y[i])
    return result


def test_exponentials_and_powers_are_numpys():
    rng = np.random.default_rng(2)
    x, y = -rng.uniform(0, 30, 5000), rng.uniform(-2, 2, 5000)
    exponentials, powers = each(x, y)
    assert np.array_equal(exponentials, np.exp(x))
    assert np.array_equal(powers, np.power(-x, y))
