"""Sensors of one search: instrument readings, and the observation vector made of them."""

# ruff: noqa: ANN001, ANN201, ANN202, N806 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import math

import numpy as np

from gslcosim.training.batch.batch_records import (
    AMOUNT,
    ANEMOMETER,
    ANEMOMETER_3D,
    AVERAGING,
    BINARY,
    BUMP,
    CLOSENESS,
    COUNT,
    HITS,
    LOG_RESISTANCE,
    MOST_GASES,
    MOX,
    PID,
    PLAIN,
    PLANAR_WIND,
    RANGES,
    SAMPLE_LENGTH,
    SECOND_ORDER,
    SPEEDS,
    THRESHOLD,
)
from gslcosim.training.batch.free_space import array_at, copy_inplace, exact_sum, norm2
from gslcosim.training.batch.pcg64 import next_normal_inplace, next_poisson_inplace
from gslcosim.training.batch.reference_free_kernels import reference_free_njit
from gslcosim_services.sensing.ray_kernels import distance_among_boxes

# See `gslcosim_services.sensing.models.mox` and `gslcosim.search.learned.encoding`.
_LEAST_RATIO = 0.01
_SPEED_M_S = 2.0
_FLOOR_PPM = 0.1
_MOST_PPM = 10_000.0
_CLEAN_OHM = 1e4
_RANGE_M = 1.0
_HITS = 3.0
_AMOUNT_SCALE = math.log1p(_MOST_PPM / _FLOOR_PPM)


@reference_free_njit()
def steady_ratio(instrument, n_gases, ppm):
    """Return Rs/R0 that a MOX sensor settles to in a mixture; see `gslcosim_services.sensing.models.mox.steady_ratio`.

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


@reference_free_njit()
def _wrapped(angle_rad):
    while angle_rad > math.pi:
        angle_rad -= 2.0 * math.pi
    while angle_rad <= -math.pi:
        angle_rad += 2.0 * math.pi
    return angle_rad


@reference_free_njit()
def _read_wind_inplace(instrument, gauge, sample, raw):
    # Gases first, then wind, then how the mount moves.
    u, v = sample[MOST_GASES] - sample[MOST_GASES + 3], sample[MOST_GASES + 1] - sample[MOST_GASES + 4]
    if instrument.kind == ANEMOMETER_3D:
        w = sample[MOST_GASES + 2] - sample[MOST_GASES + 5]
        raw[0] = u + instrument.speed_noise * next_normal_inplace(gauge.stream)
        raw[1] = v + instrument.speed_noise * next_normal_inplace(gauge.stream)
        raw[2] = w + instrument.speed_noise * next_normal_inplace(gauge.stream)
        return
    speed_draw = next_normal_inplace(gauge.stream)
    direction_draw = next_normal_inplace(gauge.stream)
    speed_m_s = norm2(u, v) + instrument.speed_noise * speed_draw
    direction_rad = math.atan2(0.0 - v, 0.0 - u) + instrument.direction_noise * direction_draw
    raw[0] = max(0.0, speed_m_s)
    raw[1] = _wrapped(direction_rad)


@reference_free_njit()
def _read_mox(instrument, gauge, n_gases, sample):
    if not gauge.has_begun:
        gauge.ratio = instrument.air_ratio
    else:
        target = steady_ratio(instrument, n_gases, sample)
        frac = instrument.rise_frac if target < gauge.ratio else instrument.decay_frac
        gauge.ratio += frac * (target - gauge.ratio)
    return instrument.r0_ohm * gauge.ratio


# See `gslcosim_services.sensing.models.gas_sensors`, of which each is one branch here.
@reference_free_njit()
def _read_ppm(instrument, gauge, memory, tick, n_gases, sample, parts):
    kind = instrument.kind
    if kind == PID:
        for g in range(n_gases):
            sample[g] = sample[g] / instrument.weight[g] if instrument.weight[g] != 0.0 else 0.0
    ppm = sample[0] if n_gases == 1 else exact_sum(sample, n_gases, parts)
    if kind == THRESHOLD:
        noise_ppm = instrument.own_noise * next_normal_inplace(gauge.stream)
        return max(0.0, ppm + noise_ppm) if ppm > instrument.threshold_ppm else 0.0
    if kind == BINARY:
        noise_ppm = instrument.own_noise * next_normal_inplace(gauge.stream)
        return 1.0 if ppm + noise_ppm > instrument.threshold_ppm else 0.0
    if kind in (HITS, AVERAGING):
        n = instrument.n_kept
        kept = memory[instrument.first_memory : instrument.first_memory + n]
        if kind == AVERAGING:
            kept[tick % n] = ppm
            # The oldest first, as a queue has them.
            return exact_sum(kept, min(tick + 1, n), parts) / min(tick + 1, n)
        kept[tick % n] = next_poisson_inplace(gauge.stream, instrument.hits_per_ppm * max(0.0, ppm))
        total = 0.0
        for k in range(min(tick + 1, n)):
            total += kept[k]
        return total
    if kind == SECOND_ORDER:
        lags = instrument.response if ppm > gauge.second_ppm else instrument.recovery
        gap_first, gap_second = gauge.first_ppm - ppm, gauge.second_ppm - ppm
        gauge.first_ppm = ppm + lags[0] * gap_first
        gauge.second_ppm = ppm + lags[1] * gap_second + lags[2] * gap_first
        return max(0.0, gauge.second_ppm)
    return ppm


@reference_free_njit()
def _read_ranges_inplace(instrument, gauge, room, position_m, rotation, raw):
    boxes_m = array_at(room.ray_boxes_m, (room.n_ray_boxes, 6), np.float64)
    n_bins = room.ray_shape[0] * room.ray_shape[1] * room.ray_shape[2]
    first = array_at(room.ray_first, n_bins + 1, np.int64)
    members = array_at(room.ray_members, first[n_bins], np.int64)
    R, mount_m, limit_m = rotation, instrument.mount_m, instrument.max_range_m
    x_m = position_m[0] + (R[0] * mount_m[0] + R[1] * mount_m[1] + R[2] * mount_m[2])
    y_m = position_m[1] + (R[3] * mount_m[0] + R[4] * mount_m[1] + R[5] * mount_m[2])
    z_m = position_m[2] + (R[6] * mount_m[0] + R[7] * mount_m[1] + R[8] * mount_m[2])
    for n in range(instrument.n_values):
        a, b, c = instrument.directions[n, 0], instrument.directions[n, 1], instrument.directions[n, 2]
        dx, dy = R[0] * a + R[1] * b + R[2] * c, R[3] * a + R[4] * b + R[5] * c
        dz = R[6] * a + R[7] * b + R[8] * c
        raw[n] = distance_among_boxes(
            boxes_m, first, members, room.ray_origin_m, room.ray_bin_m, room.ray_shape,
            x_m, y_m, z_m, dx, dy, dz, limit_m,
        )  # fmt: skip
    if instrument.own_noise != 0.0:
        for n in range(instrument.n_values):
            noisy_m = raw[n] + instrument.own_noise * next_normal_inplace(gauge.stream)
            raw[n] = min(max(noisy_m, 0.0), limit_m) if raw[n] < limit_m else limit_m


@reference_free_njit()
def _sample_inplace(instrument, memory, tick, n_gases, work):
    # Writes what the instrument sees now: gas, wind and how it moves, as they were `delay_ticks` ago.
    sample, n = work.sample, instrument.place
    ppm = array_at(work.ppm, (work.n_places, MOST_GASES), np.float64)
    wind_m_s = array_at(work.wind_m_s, (work.n_places, 3), np.float64)
    velocity_m_s = array_at(work.velocity_m_s, (work.n_places, 3), np.float64)
    for g in range(n_gases):
        sample[g] = ppm[n, g]
    for axis in range(3):
        sample[MOST_GASES + axis] = wind_m_s[n, axis]
        sample[MOST_GASES + 3 + axis] = velocity_m_s[n, axis]
    if instrument.delay_ticks == 0:
        return
    first, length = instrument.first_memory + instrument.n_kept, instrument.delay_ticks + 1
    at = first + (tick % length) * SAMPLE_LENGTH
    copy_inplace(memory[at : at + SAMPLE_LENGTH], sample)
    at = first + (max(0, tick - instrument.delay_ticks) % length) * SAMPLE_LENGTH
    copy_inplace(sample, memory[at : at + SAMPLE_LENGTH])


@reference_free_njit()
def read_inplace(instrument, gauge, memory, search, room, tick, tick_s, n_gases, work):
    """Read an instrument at the end of a tick.

    Args:
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`; its state and its last values are advanced.
        memory: (n,) the samples of late of all instruments of the search.
        search: Record of `SEARCH`.
        room: Record of `ROOM`.
        tick: The tick.
        tick_s: Length of a tick [s].
        n_gases: How many gases there are.
        work: Record of `WORK`, with what is true at the sensors' places.

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    kind, raw = instrument.kind, work.raw
    if kind == RANGES:
        _read_ranges_inplace(instrument, gauge, room, search.position_m, work.rotation, raw)
    elif kind == BUMP:
        kept = memory[instrument.first_memory : instrument.first_memory + instrument.n_kept]
        kept[tick % instrument.n_kept] = 1.0 if search.is_bumped else 0.0
        raw[0] = 0.0
        for k in range(min(tick + 1, instrument.n_kept)):
            raw[0] = max(raw[0], kept[k])
    else:
        _sample_inplace(instrument, memory, tick, n_gases, work)
        if kind == MOX:
            raw[0] = _read_mox(instrument, gauge, n_gases, work.sample)
        elif kind in (ANEMOMETER, ANEMOMETER_3D):
            _read_wind_inplace(instrument, gauge, work.sample, raw)
        else:
            raw[0] = _read_ppm(instrument, gauge, memory, tick, n_gases, work.sample, work.parts)
    is_first = not gauge.has_begun
    gauge.has_begun = 1
    if not instrument.has_errors:
        for k in range(instrument.n_values):
            gauge.values[k] = raw[k]
        return
    if is_first or tick % instrument.period_ticks == 0:
        _disturb_inplace(instrument, gauge, tick, tick_s, raw)
    gauge.is_warming_up = tick < instrument.warm_up_ticks


@reference_free_njit()
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


@reference_free_njit()
def amount(ppm):
    """Return a mixing ratio as a number between -1 and 1; see `gslcosim.search.learned.encoding.amount`."""
    return math.copysign(math.log1p(abs(ppm) / _FLOOR_PPM) / _AMOUNT_SCALE, ppm)


@reference_free_njit()
def estimated_ppm(instrument, resistance_ohm):
    """Return the mixing ratio at which a MOX sensor settles, as `sensing.models.mox` does."""
    ratio = max(resistance_ohm / instrument.r0_ohm, 1e-12)
    if ratio >= instrument.air_ratio * (1.0 - 1e-9):
        return 0.0
    exponent = math.log(ratio / instrument.estimate_a) / instrument.estimate_b
    return math.exp(min(exponent, 700.0))


@reference_free_njit()
def _show(numbers, i, value):
    numbers[i] = min(max(value, -1.0), 1.0)


@reference_free_njit()
def write_reading_inplace(numbers, instrument, gauge):
    """Write the numbers of a reading into an observation; see `gslcosim.search.learned.encoding`.

    Args:
        numbers: (n,) float32, written where the instrument's stand.
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`.
    """
    i, values, kind = instrument.first_number, gauge.values, instrument.numbers
    if gauge.is_warming_up:
        for k in range(instrument.n_numbers):
            numbers[i + k] = 0.0
        if instrument.has_estimate:
            numbers[instrument.estimate_number] = 0.0
    elif kind == LOG_RESISTANCE:
        _show(numbers, i, math.log10(max(values[0], 1.0) / _CLEAN_OHM))
        if instrument.has_estimate:
            _show(numbers, instrument.estimate_number, amount(estimated_ppm(instrument, values[0])))
    elif kind == PLANAR_WIND:
        _show(numbers, i, math.tanh(values[0] / _SPEED_M_S))
        _show(numbers, i + 1, math.sin(values[1]))
        _show(numbers, i + 2, math.cos(values[1]))
    elif kind == AMOUNT:
        _show(numbers, i, amount(values[0]))
    elif kind == PLAIN:
        _show(numbers, i, values[0])
    elif kind == COUNT:
        _show(numbers, i, math.tanh(values[0] / _HITS))
    elif kind == SPEEDS:
        for k in range(3):
            _show(numbers, i + k, math.tanh(values[k] / _SPEED_M_S))
    elif kind == CLOSENESS:
        for k in range(instrument.n_numbers):
            _show(numbers, i + k, _RANGE_M / (_RANGE_M + max(values[k], 0.0)))


@reference_free_njit()
def write_pose_inplace(numbers, search, case, time_s):
    """Write place, attitude, velocity, time and notice into an observation, its first ten numbers."""
    for axis in range(3):
        _show(numbers, axis, (search.position_m[axis] - case.centre_m[axis]) / case.half_m[axis])
        _show(numbers, 5 + axis, math.tanh(search.velocity_m_s[axis] / _SPEED_M_S))
    numbers[3], numbers[4] = search.yaw_sin, search.yaw_cos
    _show(numbers, 8, time_s / case.time_limit_s)
    numbers[9] = 1.0 if search.notice else 0.0
