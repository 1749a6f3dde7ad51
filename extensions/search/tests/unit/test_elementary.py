"""Functions of search methods: near those of numpy, the same alone and in arrays, and exact at their limits."""

import math

import mpmath
import numpy as np
import pytest

from gslcosim_search import elementary

RNG = np.random.default_rng(1)
NUMBERS = np.concatenate([RNG.normal(size=500), 10.0 ** RNG.uniform(-300.0, 2.0, 500) * RNG.choice((-1.0, 1.0), 500)])


def ulps(found, expected):
    return np.abs(found - expected) / np.spacing(np.abs(expected))


@pytest.mark.parametrize("name", ["tanh", "expm1"])
def test_functions_of_any_number(name):
    assert ulps(getattr(elementary, f"{name}_each")(NUMBERS), getattr(np, name)(NUMBERS)).max() <= 4.0


def test_the_logarithm_of_the_gamma_function_is_that_of_mpmath():
    for x in np.random.default_rng(3).uniform(0.01, 40.0, 500).tolist():
        assert elementary.lgamma(x) == pytest.approx(float(mpmath.loggamma(x)), rel=1e-14, abs=1e-14)


def test_logarithms():
    assert ulps(elementary.log_each(np.abs(NUMBERS)), np.log(np.abs(NUMBERS))).max() <= 2.0


def test_angles():
    y, x = NUMBERS, RNG.permutation(NUMBERS)
    assert ulps(elementary.atan2_each(y, x), np.arctan2(y, x)).max() <= 2.0


@pytest.mark.parametrize("name", ["tanh", "log", "expm1"])
def test_an_array_has_the_bits_of_its_numbers(name):
    alone = [getattr(elementary, name)(x) for x in np.abs(NUMBERS).tolist()]
    assert getattr(elementary, f"{name}_each")(np.abs(NUMBERS)).tolist() == alone


def test_angles_of_arrays_have_the_bits_of_their_numbers():
    pairs = NUMBERS.reshape(-1, 2)
    alone = [elementary.atan2(y, x) for y, x in pairs.tolist()]
    assert elementary.atan2_each(pairs[:, 0], pairs[:, 1]).tolist() == alone


def test_arrays_keep_their_shape():
    assert elementary.tanh_each(np.zeros((2, 3), np.float32)).shape == (2, 3)
    assert elementary.atan2_each(np.zeros((2, 1)), np.ones(3)).shape == (2, 3)
    assert elementary.log_each(1.0).shape == ()


def test_limits():
    assert elementary.tanh(math.inf) == 1.0
    assert elementary.tanh(-math.inf) == -1.0
    assert math.isnan(elementary.tanh(math.nan))
    assert math.copysign(1.0, elementary.tanh(-0.0)) == -1.0
    assert elementary.log_each([0.0, 1.0]).tolist() == [-math.inf, 0.0]
