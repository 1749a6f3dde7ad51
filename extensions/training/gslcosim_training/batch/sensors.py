"""Sensors of one search: instrument readings, and the observation vector made of them."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

import numpy as np

from gslcosim_search.learned.encoding import first_azimuth, scaled_speed
from gslcosim_services.sensing.models.base import add_errors, draw_drift, draw_gain, limit_value, quantize
from gslcosim_services.sensing.models.range_finders import note_contact
from gslcosim_services.sensing.ray_kernels import distance_among_boxes, noisy_range_m, turn_ray
from gslcosim_training.batch.batch_records import BUMP, MOST_GASES, RANGES, SAMPLE_LENGTH
from gslcosim_training.batch.free_space import array_at, copy_inplace
from gslcosim_training.batch.random_streams import next_normal_inplace, seed_inplace
from gslcosim_training.batch.reference_free_kernels import reference_free_njit
from gslcosim_training.batch.scalar_compilation import address_of, call_kernel


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
def _skip_ranges(instrument, gauge):
    # Ranges that nobody sees draw what others draw.
    if instrument.own_noise != 0.0:
        for _ in range(instrument.n_rays):
            next_normal_inplace(gauge.stream)


@reference_free_njit()
def _range_at(instrument, gauge, room, work, n):
    # Along one ray, of which the next has to follow: each draws a number.
    boxes_m = array_at(room.ray_boxes_m, (room.n_ray_boxes, 6), np.float64)
    n_bins = room.ray_shape[0] * room.ray_shape[1] * room.ray_shape[2]
    first = array_at(room.ray_first, n_bins + 1, np.int64)
    members = array_at(room.ray_members, first[n_bins], np.int64)
    place_m = array_at(work.places_m, (work.n_places, 3), np.float64)[instrument.place]
    directions = array_at(instrument.directions, (instrument.n_rays, 3), np.float64)
    limit_m = instrument.max_range_m
    dx, dy, dz = turn_ray(work.rotation, directions[n, 0], directions[n, 1], directions[n, 2])
    range_m = distance_among_boxes(
        boxes_m, first, members, room.ray_origin_m, room.ray_bin_m, room.ray_shape,
        place_m[0], place_m[1], place_m[2], dx, dy, dz, limit_m,
    )  # fmt: skip
    if instrument.own_noise == 0.0:
        return range_m
    return noisy_range_m(range_m, limit_m, instrument.own_noise * next_normal_inplace(gauge.stream))


@reference_free_njit()
def _read_ranges_inplace(instrument, gauge, room, work, raw):
    for n in range(instrument.n_rays):
        raw[n] = _range_at(instrument, gauge, room, work, n)


@reference_free_njit()
def _scan_inplace(instrument, gauge, room, work, nearest_m):
    # The least range of each sector, in single precision as lidars send them.
    n_azimuths, n_sectors = instrument.n_azimuths, instrument.n_sectors
    for i in range(n_sectors):
        nearest_m[i] = np.inf
    for first in range(0, instrument.n_rays, n_azimuths):
        i = 0
        for n in range(n_azimuths):
            if n == first_azimuth(i + 1, n_azimuths, n_sectors):
                i += 1
            range_m = _range_at(instrument, gauge, room, work, first + n)
            nearest_m[i] = min(nearest_m[i], np.float64(np.float32(range_m)))


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
def read_inplace(instrument, gauge, memory, search, room, tick, tick_s, n_gases, work, is_shown):
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
        is_shown: Whether the agent sees the tick.

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    raw, first, n_state = work.raw, instrument.first_memory, instrument.n_state
    is_due = not gauge.has_begun or tick % instrument.period_ticks == 0
    gauge.has_begun = 1
    if instrument.kind == RANGES:
        if not (is_due if instrument.has_errors else is_shown):
            _skip_ranges(instrument, gauge)
        elif instrument.n_sectors:
            _scan_inplace(instrument, gauge, room, work, memory[first : first + n_state])
        else:
            _read_ranges_inplace(instrument, gauge, room, work, raw)
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
    if not instrument.has_errors:
        for k in range(instrument.n_values):
            gauge.values[k] = raw[k]
        return
    if is_due:
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
def write_reading_inplace(numbers, instrument, gauge, memory, search, work):
    """Write the numbers of a reading into an observation; see `gslcosim_search.learned.encoding`.

    Args:
        numbers: (n,) float32, written where the instrument's stand.
        instrument: Record of `INSTRUMENT`.
        gauge: Record of `GAUGE`.
        memory: (n,) numbers of the search, with its state.
        search: Record of `SEARCH`.
        work: Record of `WORK`.
    """
    if instrument.n_sectors and not _is_scan_sent(instrument, search):
        return
    first, n, shown = instrument.first_number, instrument.n_numbers, work.numbers
    if instrument.encode != 0:
        shown[:] = 0.0
        if not gauge.is_warming_up:
            values, n_values = address_of(gauge.values), instrument.n_values
            if instrument.n_sectors:
                values, n_values = address_of(memory) + 8 * instrument.first_memory, instrument.n_sectors
            call_kernel(instrument.encode, (values, n_values, address_of(shown), n))
        for k in range(n):
            _show(numbers, first + k, shown[k])
    if instrument.encode_estimate != 0:
        shown[0] = 0.0
        if not gauge.is_warming_up:
            _estimate_inplace(instrument, gauge, work.raw)
            call_kernel(instrument.encode_estimate, (address_of(work.raw), 1, address_of(shown), 1))
        _show(numbers, instrument.estimate_number, shown[0])


# The ranges of a lidar come when they are new, and with each question; until then what the agent has seen stands.
@reference_free_njit()
def _is_scan_sent(instrument, search):
    tick = search.tick
    is_new = tick % instrument.period_ticks == 0 or tick == instrument.warm_up_ticks
    return search.is_asked or not instrument.has_errors or is_new


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
