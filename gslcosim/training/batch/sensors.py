"""Sensors of one search: instrument readings, and the observation vector made of them."""

# ruff: noqa: ANN001, ANN201, ANN202, N806 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import numpy as np

from gslcosim.search.learned.encoding import scaled_speed
from gslcosim.training.batch.batch_records import BUMP, MOST_GASES, RANGES, SAMPLE_LENGTH
from gslcosim.training.batch.free_space import array_at, copy_inplace
from gslcosim.training.batch.pcg64 import next_normal_inplace, seed_inplace
from gslcosim.training.batch.reference_free_kernels import reference_free_njit
from gslcosim.training.batch.scalar_compilation import address_of, call_kernel
from gslcosim_services.sensing.models.base import add_errors, draw_drift, draw_gain, limit_value, quantize
from gslcosim_services.sensing.models.range_finders import note_contact
from gslcosim_services.sensing.ray_kernels import distance_among_boxes, noisy_range_m


@reference_free_njit()
def switch_on_inplace(instrument, gauge, memory, name, seed):
    """Make an instrument a new one.

    Args:
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`; written.
        memory: (n,) numbers of the search, with its state; written.
        name: Bytes of its stream's name.
        seed: The search's seed.
    """
    seed_inplace(gauge.stream, seed, name)
    gauge.gain = draw_gain(instrument.gain_spread, gauge.stream)
    gauge.drift_per_s = draw_drift(instrument.drift_per_s, instrument.drift_spread_per_s, gauge.stream)
    gauge.has_begun = gauge.is_warming_up = 0
    first, n = instrument.first_memory, instrument.n_state
    copy_inplace(memory[first : first + n], array_at(instrument.new_state, n, np.float64))


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
            raw[n] = noisy_range_m(raw[n], limit_m, instrument.own_noise * next_normal_inplace(gauge.stream))


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
    first, length = instrument.first_memory + instrument.n_state, instrument.delay_ticks + 1
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
    raw, first, n_state = work.raw, instrument.first_memory, instrument.n_state
    if instrument.kind == RANGES:
        _read_ranges_inplace(instrument, gauge, room, search.position_m, work.rotation, raw)
    elif instrument.kind == BUMP:
        raw[0] = note_contact(memory[first : first + n_state], search.is_bumped != 0)
    else:
        _sample_inplace(instrument, memory, tick, n_gases, work)
        sample = address_of(work.sample)
        call_kernel(
            instrument.advance,
            (
                instrument.parameters, instrument.n_parameters, address_of(memory) + 8 * first, n_state,
                sample, n_gases, sample + 8 * MOST_GASES, address_of(gauge.stream),
                address_of(raw), instrument.n_values,
            ),
        )  # fmt: skip
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
    for k in range(instrument.n_values):
        value = raw[k]
        if k < instrument.n_with_errors:
            bias, drift_per_s, noise_std = instrument.bias, gauge.drift_per_s, instrument.noise_std
            value = add_errors(value, gauge.gain, bias, drift_per_s, tick, tick_s, noise_std, gauge.stream)
            value = quantize(limit_value(value, instrument.max_value, instrument.least_value), instrument.resolution)
        gauge.values[k] = value


@reference_free_njit()
def _show(numbers, i, value):
    numbers[i] = min(max(value, -1.0), 1.0)


@reference_free_njit()
def write_reading_inplace(numbers, instrument, gauge, work):
    """Write the numbers of a reading into an observation; see `gslcosim.search.learned.encoding`.

    Args:
        numbers: (n,) float32, written where the instrument's stand.
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`.
        work: Record of `WORK`.
    """
    first, n, shown = instrument.first_number, instrument.n_numbers, work.numbers
    if instrument.encode != 0:
        shown[:] = 0.0
        if not gauge.is_warming_up:
            values = address_of(gauge.values)
            call_kernel(instrument.encode, (values, instrument.n_values, address_of(shown), n))
        for k in range(n):
            _show(numbers, first + k, shown[k])
    if instrument.encode_estimate != 0:
        shown[0] = 0.0
        if not gauge.is_warming_up:
            _estimate_inplace(instrument, gauge, work.raw)
            call_kernel(instrument.encode_estimate, (address_of(work.raw), 1, address_of(shown), 1))
        _show(numbers, instrument.estimate_number, shown[0])


@reference_free_njit()
def _estimate_inplace(instrument, gauge, estimates):
    # As the owner of this unit takes them who has calibrated it; the estimate then stands in their place.
    for k in range(instrument.n_values):
        estimates[k] = gauge.values[k] / gauge.gain if k < instrument.n_with_errors else gauge.values[k]
    given, n = instrument.estimate_parameters, instrument.n_estimate_parameters
    values = address_of(estimates)
    call_kernel(instrument.estimate, (given, n, values, instrument.n_values, values))


@reference_free_njit()
def write_pose_inplace(numbers, search, case, time_s):
    """Write place, attitude, velocity, time and notice into an observation, its first ten numbers."""
    for axis in range(3):
        _show(numbers, axis, (search.position_m[axis] - case.centre_m[axis]) / case.half_m[axis])
        _show(numbers, 5 + axis, scaled_speed(search.velocity_m_s[axis]))
    numbers[3], numbers[4] = search.yaw_sin, search.yaw_cos
    _show(numbers, 8, time_s / case.time_limit_s)
    numbers[9] = 1.0 if search.notice else 0.0
