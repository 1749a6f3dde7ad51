"""Compiled code calls the loops that numpy runs, so both have the same bits."""

import numba
import numpy as np

from gslcosim_training.batch.plume_kernels import call_binary_loop, call_unary_loop, find_loop_address


@numba.njit
def each(exp, power, x, y):
    """Call both loops for each number."""
    result = np.empty((2, len(x)))
    for i in range(len(x)):
        result[0, i] = call_unary_loop(exp, x[i])
        result[1, i] = call_binary_loop(power, -x[i], y[i])
    return result


def test_exponentials_and_powers_are_numpys():
    rng = np.random.default_rng(2)
    x, y = -rng.uniform(0, 30, 5000), rng.uniform(-2, 2, 5000)
    exponentials, powers = each(find_loop_address(np.exp), find_loop_address(np.power), x, y)
    assert np.array_equal(exponentials, np.exp(x))
    assert np.array_equal(powers, np.power(-x, y))
