"""Compiled code calls the loops that numpy runs, so both have the same bits."""

import numba
import numpy as np

from gslcosim.fields.models.numpy_loop_kernels import call_of_one, call_of_two, loop_address


@numba.njit
def each(exp, power, x, y):
    """Call both loops for each number."""
    result = np.empty((2, len(x)))
    for i in range(len(x)):
        result[0, i] = call_of_one(exp, x[i])
        result[1, i] = call_of_two(power, -x[i], y[i])
    return result


def test_exponentials_and_powers_are_numpys():
    rng = np.random.default_rng(2)
    x, y = -rng.uniform(0, 30, 5000), rng.uniform(-2, 2, 5000)
    exponentials, powers = each(loop_address(np.exp), loop_address(np.power), x, y)
    assert np.array_equal(exponentials, np.exp(x))
    assert np.array_equal(powers, np.power(-x, y))
