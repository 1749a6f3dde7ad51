# pyright: basic
# ruff: noqa: A001 - kernels have no types, and symbols of equations
"""Elementary functions with the same bits on every processor, for kernels and for Python code of cores.

Those of `math`, numpy and numba come from the C library or have vector loops of their own, chosen by what a processor
offers, and differ in the last bit. These consist of additions, multiplications, divisions and square roots in a fixed
order, which IEEE 754 rounds the same everywhere. They are within one unit in the last place, except where another limit
is stated; no function raises: outside its domain the value is NaN or infinite.

Scalar functions work in compiled code and, as compiled functions, in Python. Those that end in `_each` do the same for
all numbers of an array, in Python only.

Source:
    Methods and coefficients of the polynomials: fdlibm, Sun Microsystems 1993 and 2004, and its revision in FreeBSD's
    msun; exceptions are named.
Held by:
    tests/unit/test_elementary.py
"""

import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

_LN2_HIGH, _LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10
_PER_LN2 = 1.44269504088896338700
_HALF_LN2 = 0.34657359027997264
_EXP_MAX, _EXP_MIN = 709.782712893383973096, -745.133219101941108420
_EXP_NORMAL = 708.0
_EXPM1_MIN = -40.0
_PI, _PI_LOW = 3.141592653589793, 1.2246467991473532e-16
_HALF_PI, _HALF_PI_LOW = 1.5707963267948966, 6.123233995736766e-17
_QUARTER_PI, _QUARTER_PI_LOW = 0.7853981633974483, 3.06161699786838301793e-17
_PER_HALF_PI = 6.36619772367581382433e-01
# Half pi in three parts of 33 bits, each with what is missing after it.
_HALF_PI_1, _HALF_PI_1_REST = 1.57079632673412561417, 6.07710050650619224932e-11
_HALF_PI_2, _HALF_PI_2_REST = 6.07710050630396597660e-11, 2.02226624879595063154e-21
_HALF_PI_3, _HALF_PI_3_REST = 2.02226624871116645580e-21, 8.47842766036889956997e-32
MAX_ANGLE_RAD = 1647099.0
"""Angles of a greater amount have no sine: NaN. It is 2^20 right angles; beyond, half pi would need more parts."""
# Added and taken away, it rounds a small number to a whole one.
_ROUNDER = 6755399441055744.0
_TWO_54 = 18014398509481984.0
_HIGH_BITS = np.int64(-(1 << 32))
_MANTISSA_BITS = np.int64(52)
_BIAS = np.int64(1023)
_SQRT_HALF_BITS = np.int64(0x3FE6A09E00000000)
_SMALLEST_NORMAL = 2.2250738585072014e-308
_INF, _NAN = math.inf, math.nan
_SPLIT = 134217729.0  # 2^27 + 1
_HUGE, _TINY = 1e140, 1e-140
# Coefficients of polynomials, from the constant one on.
_EXP_P = (
    1.66666666666666019037e-01, -2.77777777770155933842e-03, 6.61375632143793436117e-05, -1.65339022054652515390e-06,
    4.13813679705723846039e-08,
)  # fmt: skip
_EXPM1_Q = (
    1.0, -3.33333333333331316428e-02, 1.58730158725481460165e-03, -7.93650757867487942473e-05,
    4.00821782732936239552e-06, -2.01099218183624371326e-07,
)  # fmt: skip
_LOG_EVEN = (3.999999999940941908e-01, 2.222219843214978396e-01, 1.531383769920937332e-01)
_LOG_ODD = (6.666666666666735130e-01, 2.857142874366239149e-01, 1.818357216161805012e-01, 1.479819860511658591e-01)
_POW_L = (
    5.99999999999994648725e-01, 4.28571428578550184252e-01, 3.33333329818377432918e-01, 2.72728123808534006489e-01,
    2.30660745775561754067e-01, 2.06975017800338417784e-01,
)  # fmt: skip
_SIN_2 = (8.33333333332248946124e-03, -1.98412698298579493134e-04, 2.75573137070700676789e-06)
_COS_1 = (4.16666666666666019037e-02, -1.38888888888741095749e-03, 2.48015872894767294178e-05)
_COS_4 = (-2.75573143513906633035e-07, 2.08757232129817482790e-09, -1.13596475577881948265e-11)
_TAN_ODD = (
    1.33333333333201242699e-01, 2.18694882948595424599e-02, 3.59207910759131235356e-03, 5.88041240820264096874e-04,
    7.81794442939557092300e-05, -1.85586374855275456654e-05,
)  # fmt: skip
_TAN_EVEN = (
    5.39682539762260521377e-02, 8.86323982359930005737e-03, 1.45620945432529025516e-03, 2.46463134818469906812e-04,
    7.14072491382608190305e-05, 2.59073051863633712884e-05,
)  # fmt: skip
_ASIN_P = (
    1.66666666666666657415e-01, -3.25565818622400915405e-01, 2.01212532134862925881e-01, -4.00555345006794114027e-02,
    7.91534994289814532176e-04, 3.47933107596021167570e-05,
)  # fmt: skip
_ASIN_Q = (
    1.0, -2.40339491173441421878, 2.02094576023350569471, -6.88283971605453293030e-01, 7.70381505559019352791e-02,
)  # fmt: skip
_ATAN_ODD = (
    3.33333333333329318027e-01, 1.42857142725034663711e-01, 9.09088713343650656196e-02, 6.66107313738753120669e-02,
    4.97687799461593236017e-02, 1.62858201153657823623e-02,
)  # fmt: skip
_ATAN_EVEN = (
    -1.99999999998764832476e-01, -1.11111104054623557880e-01, -7.69187620504482999495e-02,
    -5.83357013379057348645e-02, -3.65315727442169155270e-02,
)  # fmt: skip
_ERF_P = (
    1.28379167095512558561e-01, -3.25042107247001499370e-01, -2.84817495755985104766e-02, -5.77027029648944159157e-03,
    -2.37630166566501626084e-05,
)  # fmt: skip
_ERF_Q = (
    1.0, 3.97917223959155352819e-01, 6.50222499887672944485e-02, 5.08130628187576562776e-03,
    1.32494738004321644526e-04, -3.96022827877536812320e-06,
)  # fmt: skip
_ERF_NEAR_1_P = (
    -2.36211856075265944077e-03, 4.14856118683748331666e-01, -3.72207876035701323847e-01, 3.18346619901161753674e-01,
    -1.10894694282396677476e-01, 3.54783043256182359371e-02, -2.16637559486879084300e-03,
)  # fmt: skip
_ERF_NEAR_1_Q = (
    1.0, 1.06420880400844228286e-01, 5.40397917702171048937e-01, 7.18286544141962662868e-02,
    1.26171219808761642112e-01, 1.36370839120290507362e-02, 1.19844998467991074170e-02,
)  # fmt: skip
_ERFC_P = (
    -9.86494403484714822705e-03, -6.93858572707181764372e-01, -1.05586262253232909814e01, -6.23753324503260060396e01,
    -1.62396669462573470355e02, -1.84605092906711035994e02, -8.12874355063065934246e01, -9.81432934416914548592,
)  # fmt: skip
_ERFC_Q = (
    1.0, 1.96512716674392571292e01, 1.37657754143519042600e02, 4.34565877475229228821e02, 6.45387271733267880336e02,
    4.29008140027567833386e02, 1.08635005541779435134e02, 6.57024977031928170135, -6.04244152148580987438e-02,
)  # fmt: skip
_ERFC_FAR_P = (
    -9.86494292470009928597e-03, -7.99283237680523006574e-01, -1.77579549177547519889e01, -1.60636384855821916062e02,
    -6.37566443368389627722e02, -1.02509513161107724954e03, -4.83519191608651397019e02,
)  # fmt: skip
_ERFC_FAR_Q = (
    1.0, 3.03380607434824582924e01, 3.25792512996573918826e02, 1.53672958608443695994e03, 3.19985821950859553908e03,
    2.55305040643316442583e03, 4.74528541206955367215e02, -2.24409524465858183362e01,
)  # fmt: skip
# Numbers of the functions of `_each`.
_EXP, _EXPM1, _LOG, _LOG1P, _LOG2, _SIN, _COS, _CBRT = range(8)
_POW, _ATAN2 = range(2)


@numba.njit(cache=True, nogil=True, inline="always")
def _bits(x):
    return np.float64(x).view(np.int64)


@numba.njit(cache=True, nogil=True, inline="always")
def _number(bits):
    return np.int64(bits).view(np.float64)


@numba.njit(cache=True, nogil=True, inline="always")
def _high(x):
    # Its upper 21 bits: products of two such numbers are exact.
    return _number(_bits(x) & _HIGH_BITS)


@numba.njit(cache=True, nogil=True, inline="always")
def _two_to(k):
    return _number((np.int64(k) + _BIAS) << _MANTISSA_BITS)


@numba.njit(cache=True, nogil=True, inline="always")
def _horner(x, coefficients):
    value = coefficients[-1]
    for i in range(len(coefficients) - 2, -1, -1):
        value = coefficients[i] + x * value
    return value


@numba.njit(cache=True, nogil=True)
def _scale(x, k):
    # x 2^k with one rounding, for x in [0.5, 2] and any k a result can have.
    if k > 1023:
        return x * 2.0 * _two_to(1023) if k == 1024 else x * _INF
    if k < -1021:
        return x * _two_to(max(k + 1000, -1022)) * _two_to(-1000)
    return x * _two_to(k)


@numba.njit(cache=True, nogil=True)
def exp(x):
    """Return e^x: 2^k e^r with r = x - k ln 2, e^r by a rational function."""
    x = np.float64(x)
    if not abs(x) < _EXP_NORMAL and not _EXP_MIN <= x <= _EXP_MAX:
        return x if x != x else (_INF if x > 0.0 else 0.0)
    k = (x * _PER_LN2 + _ROUNDER) - _ROUNDER
    high, low = x - k * _LN2_HIGH, k * _LN2_LOW
    r = high - low
    t = r * r
    c = r - t * (_horner(t, _EXP_P))
    y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
    return y * _two_to(k) if abs(x) < _EXP_NORMAL else _scale(y, np.int64(k))


@numba.njit(cache=True, nogil=True)
def expm1(x):
    """Return e^x - 1, also near zero."""
    x = np.float64(x)
    if x > _EXP_MAX:
        return _INF
    if not x >= _EXPM1_MIN:
        return x if x != x else -1.0
    if abs(x) < 1e-17:
        return x
    k, c = 0, 0.0
    if abs(x) > _HALF_LN2:
        n = (x * _PER_LN2 + _ROUNDER) - _ROUNDER
        k = np.int64(n)
        high, low = x - n * _LN2_HIGH, n * _LN2_LOW
        x = high - low
        c = (high - x) - low
    half = 0.5 * x
    hxs = x * half
    r = _horner(hxs, _EXPM1_Q)
    t = 3.0 - r * half
    e = hxs * ((r - t) / (6.0 - x * t))
    if k == 0:
        return x - (x * e - hxs)
    e = (x * (e - c) - c) - hxs
    if k == -1:
        return 0.5 * (x - e) - 0.5
    if k == 1:
        return -2.0 * (e - (x + 0.5)) if x < -0.25 else 1.0 + 2.0 * (x - e)
    if k <= -2 or k > 56:
        return _scale(1.0 - (e - x), k) - 1.0
    if k < 20:
        return ((1.0 - _two_to(-k)) - (e - x)) * _two_to(k)
    return ((x - (e + _two_to(-k))) + 1.0) * _two_to(k)


@numba.njit(cache=True, nogil=True, inline="always")
def _log_tail(f):
    # log(1 + f) - f + f^2 / 2 for 1 + f between the square roots of a half and of two.
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    even = w * (_horner(w, _LOG_EVEN))
    odd = z * (_horner(w, _LOG_ODD))
    return s * (0.5 * f * f + (even + odd))


@numba.njit(cache=True, nogil=True, inline="always")
def _split_power(x):
    # (k, m) with x = 2^k m, m between the square roots of a half and of two, for positive finite x.
    k = np.int64(0)
    if x < _SMALLEST_NORMAL:
        x *= _TWO_54
        k -= 54
    bits = _bits(x)
    n = (bits - _SQRT_HALF_BITS) >> _MANTISSA_BITS
    return k + n, _number(bits - (n << _MANTISSA_BITS))


@numba.njit(cache=True, nogil=True)
def log(x):
    """Return the natural logarithm of x."""
    x = np.float64(x)
    if not 0.0 < x < _INF:
        return _log_outside(x)
    k, m = _split_power(x)
    f = m - 1.0
    return ((_log_tail(f) + k * _LN2_LOW) - 0.5 * f * f) + f + k * _LN2_HIGH


@numba.njit(cache=True, nogil=True)
def _log_outside(x):
    if x == 0.0:
        return -_INF
    return x if x > 0.0 else _NAN


@numba.njit(cache=True, nogil=True)
def log1p(x):
    """Return log(1 + x), also near zero."""
    x = np.float64(x)
    if not -1.0 < x < _INF:
        return _log_outside(x + 1.0)
    if abs(x) < 1e-16:
        return x
    if -0.2928 < x < 0.4142:
        return (_log_tail(x) - 0.5 * x * x) + x
    u = 1.0 + x
    k, m = _split_power(u)
    c = 0.0
    if k < 54:
        c = (1.0 - (u - x) if k >= 2 else x - (u - 1.0)) / u
    f = m - 1.0
    return ((_log_tail(f) + (k * _LN2_LOW + c)) - 0.5 * f * f) + f + k * _LN2_HIGH


@numba.njit(cache=True, nogil=True)
def log2(x):
    """Return the logarithm of x to base 2; exact for powers of two."""
    x = np.float64(x)
    if not 0.0 < x < _INF:
        return _log_outside(x)
    k, m = _split_power(x)
    f = m - 1.0
    half_square = 0.5 * f * f
    high = _high(f - half_square)
    low = ((f - high) - half_square) + _log_tail(f)
    first = high * 1.44269504072144627571
    rest = (low + high) * 1.67517131648865118353e-10 + low * 1.44269504072144627571
    total = k + first
    return (rest + ((k - total) + first)) + total


@numba.njit(cache=True, nogil=True)
def log10(x):
    """Return the logarithm of x to base 10."""
    x = np.float64(x)
    if not 0.0 < x < _INF:
        return _log_outside(x)
    k, m = _split_power(x)
    f = m - 1.0
    half_square = 0.5 * f * f
    high = _high(f - half_square)
    low = ((f - high) - half_square) + _log_tail(f)
    first, powers = high * 4.34294481878168880939e-01, k * 3.01029995663611771306e-01
    rest = (
        k * 3.69423907715893078616e-13 + (low + high) * 2.50829467116452752298e-11
    ) + low * 4.34294481878168880939e-01
    total = powers + first
    return (rest + ((powers - total) + first)) + total


@numba.njit(cache=True, nogil=True)
def pow(x, y):
    """Return x^y; NaN for a negative x with a broken y."""
    x, y = np.float64(x), np.float64(y)
    if y == 0.0 or x == 1.0:
        return 1.0
    if x != x or y != y:
        return _NAN
    if y == 1.0:
        return x
    if y == 2.0:
        return x * x
    if y == -1.0 and x != 0.0:
        return 1.0 / x
    a, sign = abs(x), 1.0
    if math.copysign(1.0, x) < 0.0:
        if y != math.floor(y):
            if 0.0 < a < _INF:
                return _NAN
        elif abs(y) < _TWO_54 and 0.5 * y != math.floor(0.5 * y):
            sign = -1.0
    if a == 1.0:
        return sign
    if abs(y) == _INF:
        return _INF if (a > 1.0) == (y > 0.0) else 0.0
    if a == 0.0 or a == _INF:
        return sign * _INF if (a == _INF) == (y > 0.0) else sign * 0.0
    return sign * _positive_power(a, y)


@numba.njit(cache=True, nogil=True)
def _positive_power(a, y):
    # 2^(y log2(a)) with the logarithm in two parts, of which the first has 21 bits.
    n = np.int64(0)
    if a < _SMALLEST_NORMAL:
        a *= _TWO_54
        n -= 54
    bits = _bits(a)
    shift = (bits >> _MANTISSA_BITS) - _BIAS
    n += shift
    a = _number(bits - (shift << _MANTISSA_BITS))
    centre, log_centre_high, log_centre_low = 1.0, 0.0, 0.0
    if 1.2247 < a < 1.7320:
        centre, log_centre_high, log_centre_low = 1.5, 5.84962487220764160156e-01, 1.35003920212974897128e-08
    elif a >= 1.7320:
        n += 1
        a *= 0.5
    # s = (a - c) / (a + c) in two parts.
    u, v = a - centre, 1.0 / (a + centre)
    s = u * v
    s_high = _high(s)
    sum_high = _high(a + centre)
    sum_low = a - (sum_high - centre)
    s_low = v * ((u - s_high * sum_high) - s_high * sum_low)
    z = s * s
    r = (z * z) * (_horner(z, _POW_L))
    r += s_low * (s_high + s)
    z = s_high * s_high
    t_high = _high(3.0 + z + r)
    t_low = r - ((t_high - 3.0) - z)
    u, v = s_high * t_high, s_low * t_high + t_low * s
    p_high = _high(u + v)
    p_low = v - (p_high - u)
    # 2 / (3 ln 2) in two parts, times the above.
    z_high = 9.61796700954437255859e-01 * p_high
    z_low = -7.02846165095275826516e-09 * p_high + p_low * 9.61796693925975554329e-01 + log_centre_low
    t = np.float64(n)
    log_high = _high(((z_high + z_low) + log_centre_high) + t)
    log_low = z_low - (((log_high - t) - log_centre_high) - z_high)
    y_high = _high(y)
    p_low = (y - y_high) * log_high + y * log_low
    p_high = y_high * log_high
    z = p_low + p_high
    if not -1080.0 < z < 1024.5:
        return _INF if z > 0.0 else 0.0
    k = (z + _ROUNDER) - _ROUNDER
    p_high -= k
    t = _high(p_low + p_high)
    u = t * 6.93147182464599609375e-01
    v = (p_low - (t - p_high)) * 6.93147180559945286227e-01 + t * -1.90465429995776804525e-09
    z = u + v
    w = v - (z - u)
    t = z * z
    c = z - t * (_horner(t, _EXP_P))
    return _scale(1.0 - (((z * c) / (c - 2.0) - (w + z * w)) - z), np.int64(k))


@numba.njit(cache=True, nogil=True)
def cbrt(x):
    """Return the cube root of x.

    A root of 5 bits by a division of the bits by three, one of 23 bits by a polynomial, and a step of Newton.
    """
    x = np.float64(x)
    a = abs(x)
    if not 0.0 < a < _INF:
        return x
    scale = 1.0
    if a < _SMALLEST_NORMAL:
        a *= _TWO_54
        scale = 2.0**-18
    t = _number((_bits(a) // 3 + (np.int64(715094163) << np.int64(32))) & _HIGH_BITS)
    r = (t * t) * (t / a)
    t = t * (
        (1.87595182427177009643 + r * (-1.88497979543377169875 + r * 1.621429720105354466140))
        + ((r * r) * r) * (-0.758397934778766047437 + r * 0.145996192886612446982)
    )
    t = _number((_bits(t) + np.int64(0x80000000)) & np.int64(-0x40000000))
    r = a / (t * t)
    r = (r - t) / ((t + t) + r)
    return math.copysign((t + t * r) * scale, x)


@numba.njit(cache=True, nogil=True)
def _reduce_angle(x):
    # (quadrant, r, rest of r) with x = quadrant pi/2 + r + rest, |r| <= pi/4.
    n = (x * _PER_HALF_PI + _ROUNDER) - _ROUNDER
    size = abs(x)
    r, w = x - n * _HALF_PI_1, n * _HALF_PI_1_REST
    y = r - w
    # Digits are lost where an angle is near a multiple of pi/2: take more of pi.
    if abs(y) < size * 2.0**-16:
        t, w = r, n * _HALF_PI_2
        r = t - w
        w = n * _HALF_PI_2_REST - ((t - r) - w)
        y = r - w
        if abs(y) < size * 2.0**-48:
            t, w = r, n * _HALF_PI_3
            r = t - w
            w = n * _HALF_PI_3_REST - ((t - r) - w)
            y = r - w
    return np.int64(n) & 3, y, (r - y) - w


@numba.njit(cache=True, nogil=True, inline="always")
def _sin_near(x, rest):
    z = x * x
    w = z * z
    r = _horner(z, _SIN_2) + z * w * (-2.50507602534068634195e-08 + z * 1.58969099521155010221e-10)
    v = z * x
    return x - ((z * (0.5 * rest - v * r) - rest) - v * -1.66666666666666324348e-01)


@numba.njit(cache=True, nogil=True, inline="always")
def _cos_near(x, rest):
    z = x * x
    w = z * z
    r = z * (_horner(z, _COS_1)) + w * w * (_horner(z, _COS_4))
    half = 0.5 * z
    w = 1.0 - half
    return w + (((1.0 - w) - half) + (z * r - x * rest))


@numba.njit(cache=True, nogil=True)
def sin(x):
    """Return the sine of an angle [rad] of at most `MAX_ANGLE_RAD`."""
    x = np.float64(x)
    if abs(x) <= _QUARTER_PI:
        return x if abs(x) < 1e-8 else _sin_near(x, 0.0)
    if not abs(x) <= MAX_ANGLE_RAD:
        return _NAN
    quadrant, y, rest = _reduce_angle(x)
    value = _cos_near(y, rest) if quadrant & 1 else _sin_near(y, rest)
    return -value if quadrant & 2 else value


@numba.njit(cache=True, nogil=True)
def cos(x):
    """Return the cosine of an angle [rad] of at most `MAX_ANGLE_RAD`."""
    x = np.float64(x)
    if abs(x) <= _QUARTER_PI:
        return _cos_near(x, 0.0)
    if not abs(x) <= MAX_ANGLE_RAD:
        return _NAN
    quadrant, y, rest = _reduce_angle(x)
    value = _sin_near(y, rest) if quadrant & 1 else _cos_near(y, rest)
    return -value if (quadrant + 1) & 2 else value


@numba.njit(cache=True, nogil=True)
def tan(x):
    """Return the tangent of an angle [rad] of at most `MAX_ANGLE_RAD`."""
    x = np.float64(x)
    if abs(x) < 1e-8:
        return x
    if not abs(x) <= MAX_ANGLE_RAD:
        return _NAN
    quadrant, y, rest = np.int64(0), x, 0.0
    if abs(x) > _QUARTER_PI:
        quadrant, y, rest = _reduce_angle(x)
    is_odd = quadrant & 1
    is_wide, sign = abs(y) >= 0.6743, math.copysign(1.0, y)
    if is_wide:
        y = (_QUARTER_PI - sign * y) + (_QUARTER_PI_LOW - sign * rest)
        rest = 0.0
    z = y * y
    w = z * z
    odd = _horner(w, _TAN_ODD)
    even = z * (_horner(w, _TAN_EVEN))
    s = z * y
    r = (rest + z * (s * (odd + even) + rest)) + 3.33333333333334091986e-01 * s
    t = y + r
    if is_wide:
        v = -1.0 if is_odd else 1.0
        return sign * (v - 2.0 * (y - (t * t / (t + v) - r)))
    if not is_odd:
        return t
    high = _high(t)
    low = r - (high - y)
    a = -1.0 / t
    a_high = _high(a)
    return a_high + a * ((1.0 + a_high * high) + a_high * low)


@numba.njit(cache=True, nogil=True, inline="always")
def _asin_ratio(t):
    p = t * (_horner(t, _ASIN_P))
    q = _horner(t, _ASIN_Q)
    return p / q


@numba.njit(cache=True, nogil=True)
def acos(x):
    """Return the angle between 0 and pi of which x is the cosine [rad]."""
    x = np.float64(x)
    if not abs(x) <= 1.0:
        return _NAN
    if abs(x) < 0.5:
        return _HALF_PI - (x - (_HALF_PI_LOW - x * _asin_ratio(x * x)))
    z = 0.5 * (1.0 - abs(x))
    s = math.sqrt(z)
    ratio = _asin_ratio(z)
    if x < 0.0:
        return _PI - 2.0 * (s + (ratio * s - _HALF_PI_LOW))
    if z == 0.0:
        return 0.0
    high = _high(s)
    return 2.0 * (high + (ratio * s + (z - high * high) / (s + high)))


@numba.njit(cache=True, nogil=True)
def _atan_in_parts(t, rest):
    # The angle of a tangent >= 0, plus a small rest, as a constant and a small number.
    high, low = 0.0, rest
    if t < 0.4375:
        pass
    elif t < 0.6875:
        t, high, low = (2.0 * t - 1.0) / (2.0 + t), 4.63647609000806093515e-01, 2.26987774529616870924e-17 + rest
    elif t < 1.1875:
        t, high, low = (t - 1.0) / (t + 1.0), _QUARTER_PI, _QUARTER_PI_LOW + rest
    elif t < 2.4375:
        t, high, low = (t - 1.5) / (1.0 + 1.5 * t), 9.82793723247329054082e-01, 1.39033110312309984516e-17 + rest
    else:
        t, high, low = -1.0 / t, _HALF_PI, _HALF_PI_LOW + rest
    z = t * t
    w = z * z
    odd = z * (_horner(w, _ATAN_ODD))
    even = w * (_horner(w, _ATAN_EVEN))
    return high, t - (t * (odd + even) - low)


@numba.njit(cache=True, nogil=True, inline="always")
def _product_and_error(x, y):
    # As Dekker has it.
    product = x * y
    t, u = x * _SPLIT, y * _SPLIT
    x_high, y_high = t - (t - x), u - (u - y)
    x_low, y_low = x - x_high, y - y_high
    return product, ((x_high * y_high - product) + x_high * y_low + x_low * y_high) + x_low * y_low


@numba.njit(cache=True, nogil=True)
def atan2(y, x):
    """Return the angle of the direction (x, y) from the x axis, between -pi and pi [rad].

    The tangent's rounding error is added to its angle, as long as both numbers are between 1e-140 and 1e140.
    """
    y, x = np.float64(y), np.float64(x)
    if x != x or y != y:
        return _NAN
    a, b = abs(y), abs(x)
    high, low = 0.0, 0.0
    if (b == 0.0 and a > 0.0) or (a == _INF and b < _INF):
        return math.copysign(_HALF_PI, y)
    if a == _INF:
        high, low = _QUARTER_PI, _QUARTER_PI_LOW
    elif a > 0.0:
        t, rest = a / b, 0.0
        if min(a, b) > _TINY and max(a, b) < _HUGE:
            product, error = _product_and_error(t, b)
            rest = ((a - product) - error) / b / (1.0 + t * t)
        high, low = _atan_in_parts(t, rest)
    if math.copysign(1.0, x) < 0.0:
        opposite = _PI - high
        return math.copysign(opposite + ((((_PI - opposite) - high) + _PI_LOW) - low), y)
    return math.copysign(high + low, y)


@numba.njit(cache=True, nogil=True)
def erfc(x):
    """Return the complement of the error function, within three units in the last place."""
    x = np.float64(x)
    a = abs(x)
    if not a < 28.0:
        return x if x != x else (0.0 if x > 0.0 else 2.0)
    if a < 0.84375:
        z = x * x
        r = _horner(z, _ERF_P)
        s = _horner(z, _ERF_Q)
        y = r / s
        return 1.0 - (x + x * y) if x < 0.25 else 0.5 - (x * y + (x - 0.5))
    if a < 1.25:
        s = a - 1.0
        p = _horner(s, _ERF_NEAR_1_P)
        q = _horner(s, _ERF_NEAR_1_Q)
        erx = 8.45062911510467529297e-01
        return (1.0 - erx) - p / q if x > 0.0 else 1.0 + (erx + p / q)
    if x < -6.0:
        return 2.0
    s = 1.0 / (a * a)
    if a < 1.0 / 0.35:
        p = _horner(s, _ERFC_P)
        q = _horner(s, _ERFC_Q)
    else:
        p = _horner(s, _ERFC_FAR_P)
        q = _horner(s, _ERFC_FAR_Q)
    z = _high(a)
    r = exp(-z * z - 0.5625) * exp((z - a) * (z + a) + p / q) / a
    return r if x > 0.0 else 2.0 - r


# In place of BLAS and LAPACK, whose order of sums depends on the processor; for a few numbers.


def product(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Return a @ b, a of any number of dimensions and b of one or two; each sum begins with its first term."""
    left, right = np.ascontiguousarray(a, np.float64), np.ascontiguousarray(b, np.float64)
    rows = left.reshape(-1, left.shape[-1])
    columns = right.reshape(-1, 1) if right.ndim == 1 else right
    return _matrix_product(rows, columns).reshape(left.shape[:-1] + right.shape[1:])


@numba.njit(cache=True, nogil=True)
def _matrix_product(a, b):
    c = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            for j in range(b.shape[1]):
                c[i, j] += a[i, k] * b[k, j]
    return c


def solve(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """Return the (n, k) matrix x with a x = b of an (n, n) and an (n, k) matrix; not finite where a is singular."""
    return _eliminate(np.array(a, np.float64), np.array(b, np.float64))


@numba.njit(cache=True, nogil=True)
def _eliminate(a, x):
    # Gauss, with the largest pivot of each column.
    n = a.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        for j in range(n):
            a[k, j], a[best, j] = a[best, j], a[k, j]
        for j in range(x.shape[1]):
            x[k, j], x[best, j] = x[best, j], x[k, j]
        for i in range(n):
            if i != k:
                factor = a[i, k] / a[k, k]
                for j in range(k, n):
                    a[i, j] -= factor * a[k, j]
                for j in range(x.shape[1]):
                    x[i, j] -= factor * x[k, j]
    for i in range(n):
        for j in range(x.shape[1]):
            x[i, j] /= a[i, i]
    return x


# Scalar functions for all numbers of an array.


def exp_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `exp` of each number."""
    return _each(_EXP, x)


def expm1_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `expm1` of each number."""
    return _each(_EXPM1, x)


def log_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `log` of each number."""
    return _each(_LOG, x)


def log1p_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `log1p` of each number."""
    return _each(_LOG1P, x)


def log2_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `log2` of each number."""
    return _each(_LOG2, x)


def sin_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `sin` of each number."""
    return _each(_SIN, x)


def cos_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `cos` of each number."""
    return _each(_COS, x)


def cbrt_each(x: ArrayLike) -> NDArray[np.float64]:
    """Return `cbrt` of each number."""
    return _each(_CBRT, x)


def pow_each(x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
    """Return `pow` of each pair of numbers."""
    return _each_pair(_POW, x, y)


def atan2_each(y: ArrayLike, x: ArrayLike) -> NDArray[np.float64]:
    """Return `atan2` of each pair of numbers."""
    return _each_pair(_ATAN2, y, x)


def _each(function: int, x: ArrayLike) -> NDArray[np.float64]:
    numbers = np.ascontiguousarray(x, np.float64)
    return _fill_each(function, numbers.reshape(-1), np.empty(numbers.size)).reshape(np.shape(x))


@numba.njit(cache=True, nogil=True)
def _fill_each(function, x, values):
    for i in range(x.size):
        if function == _EXP:
            values[i] = exp(x[i])
        elif function == _EXPM1:
            values[i] = expm1(x[i])
        elif function == _LOG:
            values[i] = log(x[i])
        elif function == _LOG1P:
            values[i] = log1p(x[i])
        elif function == _LOG2:
            values[i] = log2(x[i])
        elif function == _SIN:
            values[i] = sin(x[i])
        elif function == _COS:
            values[i] = cos(x[i])
        else:
            values[i] = cbrt(x[i])
    return values


def _each_pair(function: int, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
    first, second = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    return _fill_each_pair(function, first.flatten(), second.flatten(), np.empty(first.size)).reshape(first.shape)


@numba.njit(cache=True, nogil=True)
def _fill_each_pair(function, x, y, values):
    for i in range(x.size):
        values[i] = pow(x[i], y[i]) if function == _POW else atan2(x[i], y[i])
    return values
