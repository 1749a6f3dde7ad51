"""Kernels of the inertial measurement unit against the same law in plain numpy, to the bit."""

import numpy as np
import pytest

from gslcosim.sensing.inertial_kernels import inertial_samples, wander_inplace

LIMIT = np.array([2.5, 2.5, 2.5, 2.0, 2.0, 2.0])
NOISE = np.array([0.2, 0.2, 0.2, 0.1, 0.1, 0.1])


def plain_samples(inertial, n, arm_m, force_bias, rate_bias, draws):
    omega, alpha = inertial[:, 3:6], inertial[:, 6:]
    force = inertial[:, :3] + np.cross(omega, np.cross(omega, arm_m)) + np.cross(alpha, arm_m)
    rows = np.hstack([force, omega]).reshape(n, -1, 6).mean(axis=1)
    rows = rows + np.hstack([force_bias, rate_bias]) + NOISE * draws
    kept = np.clip(rows, -LIMIT, LIMIT)
    return kept, kept.mean(axis=0), (kept != rows).any()


@pytest.mark.parametrize("n", [24, 6, 1])
@pytest.mark.parametrize("arm_m", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)])
def test_samples_are_those_of_plain_numpy(n, arm_m):
    rng = np.random.default_rng(n)
    were_cut = set()
    for _ in range(30):
        inertial = rng.normal(size=(24, 9)) * np.repeat([4.0, 1.0, 5.0], 3)
        inertial.flags.writeable = False
        drawn = rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), rng.normal(size=(n, 6))
        expected = plain_samples(inertial, n, np.array(arm_m), *drawn)
        samples, means, is_cut = inertial_samples(inertial, n, np.array(arm_m), *drawn[:2], NOISE, drawn[2], LIMIT)
        assert np.array_equal(samples, expected[0])
        assert np.array_equal(means, expected[1])
        assert is_cut == expected[2]
        were_cut.add(is_cut)
    assert True in were_cut


def test_a_bias_wanders_as_in_plain_numpy_and_goes_on_from_there():
    rng = np.random.default_rng(1)
    keeps, kick, constant = 0.999, np.array([0.3, 0.1, 0.2]), np.array([5.0, 6.0, 7.0])
    powers, wandering, expected_end = keeps ** np.arange(1, 26), np.zeros(3), np.zeros(3)
    for _ in range(3):
        draws = rng.normal(size=(25, 3))
        expected = powers[:, None] * (expected_end + np.cumsum(kick * draws / powers[:, None], axis=0))
        expected_end = expected[-1]
        assert np.array_equal(wander_inplace(wandering, constant, kick, powers, draws), constant + expected)
        assert np.array_equal(wandering, expected_end)
