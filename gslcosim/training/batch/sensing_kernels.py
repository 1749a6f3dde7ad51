"""What instruments show, and how that becomes the numbers of an observation, for one search."""
# pyright: basic

import math

import numba

from gslcosim.training.batch.batch_records import ANEMOMETER, LOG_RESISTANCE, MOX
from gslcosim.training.batch.drawing_kernels import next_normal_inplace
from gslcosim.training.batch.exact_kernels import norm2

# See `gslcosim.sensing.models.mox` and `gslcosim.search.learned.observing`.
_LEAST_RATIO = 0.01
_SPEED_M_S = 2.0
_FLOOR_PPM = 0.1
_MOST_PPM = 10_000.0
_CLEAN_OHM = 1e4
_AMOUNT_SCALE = math.log1p(_MOST_PPM / _FLOOR_PPM)


@numba.njit(cache=True, nogil=True)
def steady_ratio(instrument, n_gases, ppm):
    """Return Rs/R0 that a MOX sensor settles to in a mixture; see `gslcosim.sensing.models.mox.steady_ratio`.

    Args:
        instrument: Record of `INSTRUMENT`.
        n_gases: How many gases there are.
        ppm: (>= n_gases,) mixing ratios [ppm].
    """
    air = instrument.air_ratio
    ratio = air
    for g in range(n_gases):
        if instrument.law_a[g] != 0.0 and ppm[g] > 0.0:
            ratio -= max(0.0, air - instrument.law_a[g] * ppm[g] ** instrument.law_b[g])
    return max(ratio, _LEAST_RATIO)


@numba.njit(cache=True, nogil=True)
def _wrapped(angle_rad):
    while angle_rad > math.pi:
        angle_rad -= 2.0 * math.pi
    while angle_rad <= -math.pi:
        angle_rad += 2.0 * math.pi
    return angle_rad


@numba.njit(cache=True, nogil=True)
def read_inplace(instrument, gauge, tick, tick_s, n_gases, ppm, wind_m_s, velocity_m_s, raw):
    """Read an instrument at the end of a tick.

    Args:
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`; its state and its last values are advanced.
        tick: The tick.
        tick_s: Length of a tick [s].
        n_gases: How many gases there are.
        ppm: (>= n_gases,) true mixing ratios at its place [ppm].
        wind_m_s: (3,) true wind there, world frame [m/s].
        velocity_m_s: (3,) how it moves, world frame [m/s].
        raw: (3,) scratch.
    """
    if instrument.kind == MOX:
        if not gauge.has_begun:
            gauge.ratio = instrument.air_ratio
        else:
            target = steady_ratio(instrument, n_gases, ppm)
            frac = instrument.rise_frac if target < gauge.ratio else instrument.decay_frac
            gauge.ratio += frac * (target - gauge.ratio)
        raw[0] = instrument.r0_ohm * gauge.ratio
    elif instrument.kind == ANEMOMETER:
        x, y = wind_m_s[0] - velocity_m_s[0], wind_m_s[1] - velocity_m_s[1]
        speed_draw = next_normal_inplace(gauge.stream)
        direction_draw = next_normal_inplace(gauge.stream)
        speed_m_s = norm2(x, y) + instrument.speed_noise * speed_draw
        direction_rad = math.atan2(0.0 - y, 0.0 - x) + instrument.direction_noise * direction_draw
        raw[0] = max(0.0, speed_m_s)
        raw[1] = _wrapped(direction_rad)
    is_first = not gauge.has_begun
    gauge.has_begun = 1
    if not instrument.has_errors:
        for k in range(instrument.n_values):
            gauge.values[k] = raw[k]
        return
    if is_first or tick % instrument.period_ticks == 0:
        _disturb_inplace(instrument, gauge, tick, tick_s, raw)
    gauge.is_warming_up = tick < instrument.warm_up_ticks


@numba.njit(cache=True, nogil=True)
def _disturb_inplace(instrument, gauge, tick, tick_s, raw):
    limit = instrument.max_value
    for k in range(instrument.n_values):
        value = raw[k]
        if k < instrument.n_with_errors:
            value = value + (instrument.bias + instrument.drift_per_s * tick * tick_s)
            if instrument.noise_std != 0.0:
                value = value + instrument.noise_std * next_normal_inplace(gauge.stream)
            value = min(max(value, -limit), limit)
            value = max(value, instrument.least_value)
        gauge.values[k] = value


@numba.njit(cache=True, nogil=True)
def amount(ppm):
    """Return a mixing ratio as a number between -1 and 1; see `gslcosim.search.learned.observing.amount`."""
    return math.copysign(math.log1p(abs(ppm) / _FLOOR_PPM) / _AMOUNT_SCALE, ppm)


@numba.njit(cache=True, nogil=True)
def estimated_ppm(instrument, resistance_ohm):
    """Return the mixing ratio at which a MOX sensor settles; see `gslcosim.sensing.models.mox.estimated_ppm`."""
    ratio = max(resistance_ohm / instrument.r0_ohm, 1e-12)
    if ratio >= instrument.air_ratio * (1.0 - 1e-9):
        return 0.0
    exponent = math.log(ratio / instrument.estimate_a) / instrument.estimate_b
    return math.exp(min(exponent, 700.0))


@numba.njit(cache=True, nogil=True)
def _show(numbers, i, value):
    numbers[i] = min(max(value, -1.0), 1.0)


@numba.njit(cache=True, nogil=True)
def tell_reading_inplace(numbers, instrument, gauge):
    """Write the numbers of a reading into an observation; see `gslcosim.search.learned.observing`.

    Args:
        numbers: (n,) float32, written where the instrument's stand.
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`.
    """
    i, values = instrument.first_number, gauge.values
    if gauge.is_warming_up:
        numbers[i] = 0.0
        if instrument.numbers != LOG_RESISTANCE:
            numbers[i + 1], numbers[i + 2] = 0.0, 0.0
        if instrument.has_estimate:
            numbers[instrument.estimate_number] = 0.0
    elif instrument.numbers == LOG_RESISTANCE:
        _show(numbers, i, math.log10(max(values[0], 1.0) / _CLEAN_OHM))
        if instrument.has_estimate:
            _show(numbers, instrument.estimate_number, amount(estimated_ppm(instrument, values[0])))
    else:
        _show(numbers, i, math.tanh(values[0] / _SPEED_M_S))
        _show(numbers, i + 1, math.sin(values[1]))
        _show(numbers, i + 2, math.cos(values[1]))


@numba.njit(cache=True, nogil=True)
def tell_pose_inplace(numbers, search, case, time_s):
    """Write place, attitude, velocity, time and notice into an observation, its first ten numbers."""
    for axis in range(3):
        _show(numbers, axis, (search.position_m[axis] - case.centre_m[axis]) / case.half_m[axis])
        _show(numbers, 5 + axis, math.tanh(search.velocity_m_s[axis] / _SPEED_M_S))
    numbers[3] = 0.0
    numbers[4] = 1.0
    _show(numbers, 8, time_s / case.time_limit_s)
    numbers[9] = 1.0 if search.notice else 0.0
