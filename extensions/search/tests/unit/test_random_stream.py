import math

import numpy as np
import pytest

from gslcosim_search.random_stream import RandomStream


def test_the_generator_is_splitmix64():
    """The published outputs for seed 1234567 (S. Vigna's reference program), to the 53 bits that are used."""
    draws = RandomStream(1_234_567)
    published = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431]
    assert [draws.fraction() for _ in published] == [(value >> 11) / 2**53 for value in published]


def test_fractions_angles_and_indices_are_even():
    draws = RandomStream(3)
    fractions = np.array([draws.fraction() for _ in range(4000)])
    assert (fractions.min(), fractions.max()) == pytest.approx((0.0, 1.0), abs=0.01)
    assert fractions.mean() == pytest.approx(0.5, abs=4 * math.sqrt(1 / 12 / 4000))
    draws = RandomStream(1)
    counts = np.bincount([draws.index(3) for _ in range(3000)], minlength=3)
    assert counts.sum() == 3000
    assert counts.min() > 900
    assert 0.0 <= RandomStream(8).angle_rad() < 2 * math.pi
    assert -2.0 <= RandomStream(8).uniform(-2.0, -1.0) < -1.0


def test_normals_have_mean_0_and_variance_1():
    draws = RandomStream(5)
    values = np.array([draws.normal() for _ in range(4000)])
    assert values.mean() == pytest.approx(0.0, abs=4 / math.sqrt(4000))
    assert values.var() == pytest.approx(1.0, abs=0.1)


def test_streams_of_one_seed_differ_by_their_purpose_and_repeat():
    first, again, other = (RandomStream(1).generator(name).random(3).tolist() for name in ("a", "a", "b"))
    assert first == again
    assert first != other
