"""Elementary functions: within a unit in the last place of mpmath, and the same in Python, compiled and for arrays."""

import math

import mpmath
import numba
import numpy as np
import pytest

from gslcosim.base import elementary

BITS = 160
HALF_PI = math.pi / 2


def uniform(low, high):
    return lambda rng, n: rng.uniform(low, high, n)


def magnitudes(low, high):
    """Return numbers of both signs with decimal exponents in a range."""
    return lambda rng, n: 10.0 ** rng.uniform(low, high, n) * rng.choice((-1.0, 1.0), n)


def positive(low, high):
    return lambda rng, n: 10.0 ** rng.uniform(low, high, n)


def beside(value, low, high):
    """Return numbers at a distance of a value with decimal exponents in a range."""
    return lambda rng, n: value + 10.0 ** rng.uniform(low, high, n)


def right_angles(rng, n):
    return rng.integers(1, 1_000_000, n) * HALF_PI


def cbrt(x):
    return mpmath.sign(x) * mpmath.cbrt(abs(x))


ANGLES = (uniform(-4.0, 4.0), uniform(-1.6e6, 1.6e6), magnitudes(-300.0, 5.0), right_angles)
LOGARITHMS = (positive(-323.0, 308.0), uniform(0.5, 2.0), beside(1.0, -15.0, -3.0))
# A function, its limit in units in the last place, what mpmath has, and where it is tried.
FUNCTIONS = {
    "exp": (1.0, mpmath.exp, (uniform(-745.0, 709.7), uniform(-1.0, 1.0), magnitudes(-300.0, 0.0))),
    "expm1": (1.0, mpmath.expm1, (uniform(-45.0, 709.0), uniform(-1.0, 1.0), magnitudes(-300.0, 0.0))),
    "log": (1.0, mpmath.log, LOGARITHMS),
    "log1p": (1.0, mpmath.log1p, (positive(-300.0, 300.0), uniform(-0.999999, 2.0), magnitudes(-20.0, -1.0))),
    "log2": (1.0, lambda x: mpmath.log(x, 2), LOGARITHMS),
    "log10": (1.0, lambda x: mpmath.log(x, 10), LOGARITHMS),
    "sin": (1.0, mpmath.sin, ANGLES),
    "cos": (1.0, mpmath.cos, ANGLES),
    "tan": (1.0, mpmath.tan, ANGLES),
    "acos": (1.0, mpmath.acos, (uniform(-1.0, 1.0), magnitudes(-300.0, 0.0), beside(-1.0, -16.0, -3.0))),
    "cbrt": (1.0, cbrt, (magnitudes(-323.0, 308.0), uniform(-10.0, 10.0))),
    "erfc": (3.0, mpmath.erfc, (uniform(-6.0, 26.0), uniform(-1.5, 3.0))),
    "pow": (
        1.0,
        mpmath.power,
        (
            (positive(-300.0, 300.0), magnitudes(-3.0, 0.0)),
            (uniform(0.5, 2.0), uniform(-1000.0, 1000.0)),
            (beside(1.0, -12.0, -8.0), magnitudes(3.0, 8.0)),
            (positive(-320.0, -300.0), uniform(-1.0, 1.0)),
        ),
    ),
    "atan2": (
        1.0,
        mpmath.atan2,
        ((uniform(-1.0, 1.0), uniform(-1.0, 1.0)), (magnitudes(-100.0, 100.0), magnitudes(-100.0, 100.0))),
    ),
}
SPECIAL = (0.0, -0.0, 1.0, -1.0, 0.5, 2.0, -2.5, 3.0, 5e-324, -5e-324, 1e308, -1e308, math.inf, -math.inf, math.nan)


def find_worst(name, n, seed):
    """Return the largest error in units in the last place, and where it is, of n numbers from each range."""
    _, exact, ranges = FUNCTIONS[name]
    function, rng, worst = getattr(elementary, name), np.random.default_rng(seed), (0.0, ())
    with mpmath.workprec(BITS):
        for each in ranges:
            draws = each if isinstance(each, tuple) else (each,)
            for arguments in zip(*(draw(rng, n).tolist() for draw in draws), strict=True):
                expected = exact(*map(mpmath.mpf, arguments))
                error = float(abs(mpmath.mpf(function(*arguments)) - expected) / math.ulp(float(expected)))
                worst = max(worst, (error, arguments))
    return worst


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_within_a_unit_in_the_last_place(name):
    error, where = find_worst(name, 300, 1)
    assert error <= FUNCTIONS[name][0], where


@pytest.mark.soak
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions_are_within_a_unit_in_the_last_place_everywhere(name):
    ranges = FUNCTIONS[name][2]
    error, where = find_worst(name, 1_000_000 // len(ranges), 2)
    assert error <= FUNCTIONS[name][0], where


@pytest.mark.parametrize("name", sorted(FUNCTIONS.keys() - {"pow", "atan2"}))
def test_special_numbers_give_what_the_c_library_gives(name):
    function, exact = getattr(elementary, name), getattr(np, "arc" + name[1:] if name[0] == "a" else name, None)
    for x in SPECIAL:
        if exact is None or (name in ("sin", "cos", "tan") and abs(x) > elementary.MAX_ANGLE_RAD):
            continue
        with np.errstate(all="ignore"):
            expected = float(exact(x))
        assert function(x) == pytest.approx(expected, rel=1e-15, nan_ok=True), x
        assert math.copysign(1.0, function(x)) == math.copysign(1.0, expected) or math.isnan(expected), x


@pytest.mark.parametrize("x", SPECIAL)
@pytest.mark.parametrize("y", SPECIAL)
def test_special_pairs_give_what_the_c_library_gives(x, y):
    with np.errstate(all="ignore"):
        for found, expected in (
            (elementary.atan2(y, x), float(np.arctan2(y, x))),
            # numpy takes the square root, which differs from the power at -0 and -inf.
            *([] if y == 0.5 else [(elementary.pow(x, y), float(np.power(x, y)))]),
        ):
            assert found == pytest.approx(expected, rel=1e-15, nan_ok=True)
            assert math.copysign(1.0, found) == math.copysign(1.0, expected) or math.isnan(expected)


@numba.njit
def _compiled(x, y):
    return (
        elementary.exp(x), elementary.log(y), elementary.sin(x), elementary.cos(x), elementary.atan2(x, y),
        elementary.pow(y, x), elementary.cbrt(x), elementary.expm1(x), elementary.log1p(y), elementary.tan(x),
    )  # fmt: skip


def test_bits_are_the_same_compiled_in_python_and_for_arrays():
    rng = np.random.default_rng(4)
    x, y = rng.normal(size=500), rng.exponential(size=500)
    e = elementary
    rows = np.array([_compiled(a, b) for a, b in zip(x, y, strict=True)]).T
    plain = [
        (
            e.exp(a),
            e.log(b),
            e.sin(a),
            e.cos(a),
            e.atan2(a, b),
            e.pow(b, a),
            e.cbrt(a),
            e.expm1(a),
            e.log1p(b),
            e.tan(a),
        )
        for a, b in zip(x.tolist(), y.tolist(), strict=True)
    ]
    assert np.array_equal(rows, np.array(plain).T)
    for row, numbers in (
        (0, e.exp_each(x)), (2, e.sin_each(x)), (3, e.cos_each(x)), (5, e.pow_each(y, x)), (6, e.cbrt_each(x)),
        (8, e.log1p_each(y)),
    ):  # fmt: skip
        assert np.array_equal(rows[row], numbers)


def test_functions_of_arrays_keep_their_shape():
    assert elementary.exp_each(np.zeros((2, 3))).shape == (2, 3)
    assert elementary.cos_each(0.0).shape == ()
    assert elementary.pow_each(2.0, [[1.0, 2.0]]).tolist() == [[2.0, 4.0]]
    assert np.array_equal(elementary.log2_each([8.0]), [3.0])


def test_products_of_matrices_are_sums_in_order():
    rng = np.random.default_rng(5)
    a, b = rng.normal(size=(3, 4)), rng.normal(size=(4, 2))
    in_order = [[sum((a[i, k] * b[k, j] for k in range(4)), 0.0) for j in range(2)] for i in range(3)]
    assert elementary.product(a, b).tolist() == in_order
    assert elementary.product(a, b[:, 0]).tolist() == [row[0] for row in in_order]
    assert elementary.product(a[0], b).tolist() == in_order[0]
    assert elementary.product(a[None], b).tolist() == [in_order]
    assert elementary.product(a.T, [1.0, 2.0, 3.0]) == pytest.approx(a.T @ [1.0, 2.0, 3.0])


def test_linear_equations_are_solved():
    rng = np.random.default_rng(6)
    a, x = rng.normal(size=(6, 6)), rng.normal(size=(6, 2))
    a[0, 0] = 0.0
    assert elementary.solve(a, a @ x) == pytest.approx(x)
