import math

import numba
import numpy as np
import pytest

from gslcosim_services.fields.filament.counter_rng import (
    BATCH,
    TAIL_START,
    derive_step_key,
    draw_filament_normals,
    mix_bits,
    normal_at,
    uniform_at,
)

KEY = np.uint64(20261121)
GOLDEN = 0x9E3779B97F4A7C15


@numba.njit(nogil=True)
def draw_normals(key, first, n):
    draws = np.empty(n)
    for i in range(n):
        draws[i] = normal_at(key, np.uint64(first + i))
    return draws


def test_mixing_a_counter_gives_the_published_splitmix64_sequence():
    """Seed 1234567 is the sequence given with the reference implementation of SplitMix64."""
    states = [np.uint64((1234567 + (i + 1) * GOLDEN) % 2**64) for i in range(3)]
    assert [int(mix_bits(s)) for s in states] == [6457827717110365317, 3203168211198807973, 9817491932198370423]


def test_moments_are_those_of_the_standard_normal():
    n = 400_000
    draws = draw_normals(KEY, 0, n)
    for power, expected, variance in ((1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)):
        assert (draws**power).mean() == pytest.approx(expected, abs=4 * math.sqrt(variance / n))


def test_distribution_is_the_standard_normal_within_sampling_error():
    """Kolmogorov-Smirnov distance below the value that chance exceeds once in ten thousand times."""
    n = 400_000
    draws = np.sort(draw_normals(KEY, 7, n))
    cumulative = np.array([0.5 * math.erfc(-x / math.sqrt(2)) for x in draws[:: n // 2000]])
    assert np.abs(cumulative - np.arange(0, n, n // 2000) / n).max() < 2.23 / math.sqrt(n)


def test_tail_beyond_the_ziggurats_base_has_its_weight():
    n = 2_000_000
    tail = np.abs(draw_normals(KEY, 11, n))
    expected = n * math.erfc(TAIL_START / math.sqrt(2))
    assert (tail > TAIL_START).sum() == pytest.approx(expected, abs=4 * math.sqrt(expected))
    assert tail.max() > 4.5


@pytest.mark.parametrize("lag", [1, 2, 3])
def test_neighbouring_counters_are_uncorrelated(lag):
    draws = draw_normals(KEY, 0, 200_000)
    for transform in (draws, draws**2 - 1):
        correlation = (transform[lag:] * transform[:-lag]).mean() / (transform**2).mean()
        assert abs(correlation) < 4 / math.sqrt(len(draws))


def test_neighbouring_steps_are_uncorrelated():
    first, second = (draw_normals(derive_step_key(KEY, step), 0, 200_000) for step in (41, 42))
    assert abs((first * second).mean()) < 4 / math.sqrt(len(first))


def test_a_draw_depends_on_key_and_counter_alone():
    together = draw_normals(KEY, 0, 1000)
    assert [normal_at(KEY, np.uint64(i)) for i in range(999, -1, -1)] == list(together[::-1])


def test_a_batch_of_filaments_draws_the_same_numbers_as_each_alone():
    """To the bit, ids of any source; often enough for draws outside of the core and in the tail."""
    bits, listed, draws = np.zeros(3 * BATCH, np.uint64), np.zeros(3 * BATCH, np.int64), np.zeros(3 * BATCH)
    largest = 0.0
    for step in range(200):
        key, n = np.uint64(derive_step_key(KEY, step)), 1 + 37 * step % BATCH
        ids = np.arange(n) * 3 + (step % 4) * 2**40
        draw_filament_normals(key, ids, bits, listed, draws)
        alone = [[normal_at(key, np.uint64(3 * i + axis)) for i in ids.tolist()] for axis in range(3)]
        np.testing.assert_array_equal(draws.reshape(3, BATCH)[:, :n], alone)
        largest = max(largest, np.abs(alone).max())
    assert largest > TAIL_START


def test_uniform_draws_fill_the_interval_without_zero():
    draws = np.array([uniform_at(KEY, np.uint64(i)) for i in range(20_000)])
    assert 0.0 < draws.min() < 1e-3
    assert 1 - 1e-3 < draws.max() <= 1.0
    assert draws.mean() == pytest.approx(0.5, abs=4 / math.sqrt(12 * len(draws)))
