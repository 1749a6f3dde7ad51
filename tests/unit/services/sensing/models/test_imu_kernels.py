"""Kernels of the inertial measurement unit against the same law in plain numpy, to the bit."""

import numpy as np
import pytest

from gslcosim.base.rng import stream
from gslcosim_services.sensing.models.base import GaussMarkovBias, decay_factor, increment_std
from gslcosim_services.sensing.models.imu_kernels import advance_bias_inplace, sample_imu

LIMIT = np.array([2.5, 2.5, 2.5, 2.0, 2.0, 2.0])
NOISE = np.array([0.2, 0.2, 0.2, 0.1, 0.1, 0.1])
CONSTANT = np.array([0.3, 0.2, 0.1, -0.1, -0.2, -0.3])
KICK, KEEPS = np.array([0.3, 0.1]), np.array([0.999, 0.99])


def plain_samples(inertial, n, arm_m, wandering, draws):
    omega, alpha = inertial[:, 3:6], inertial[:, 6:]
    force = inertial[:, :3] + np.cross(omega, np.cross(omega, arm_m)) + np.cross(alpha, arm_m)
    rows = np.hstack([force, omega]).reshape(n, -1, 6).mean(axis=1)
    halves = []
    for half in range(2):
        powers = KEEPS[half] ** np.arange(1, n + 1)[:, None]
        pushes = KICK[half] * draws[3 * n * half : 3 * n * (half + 1)].reshape(n, 3) / powers
        halves.append(powers * (wandering[3 * half : 3 * half + 3] + np.cumsum(pushes, axis=0)))
    biases = np.hstack(halves)
    rows = rows + (CONSTANT + biases) + NOISE * draws[6 * n :].reshape(n, 6)
    kept = np.clip(rows, -LIMIT, LIMIT)
    return kept, kept.mean(axis=0), (kept != rows).any(), biases[-1]


@pytest.mark.parametrize("n", [24, 6, 1])
@pytest.mark.parametrize("arm_m", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)])
def test_samples_are_those_of_plain_numpy(n, arm_m):
    rng = np.random.default_rng(n)
    arm_m, powers, wandering = np.array(arm_m), KEEPS[:, None] ** np.arange(1, n + 1), np.zeros(6)
    were_cut = set()
    for _ in range(30):
        inertial = rng.normal(size=(24, 9)) * np.repeat([4.0, 1.0, 3.0], 3)
        inertial.flags.writeable = False
        draws = rng.normal(size=12 * n)
        expected = plain_samples(inertial, n, arm_m, wandering.copy(), draws)
        samples, means, is_cut = sample_imu(inertial, arm_m, CONSTANT, wandering, KICK, powers, NOISE, LIMIT, draws)
        assert np.array_equal(samples, expected[0])
        assert np.array_equal(means, expected[1])
        assert is_cut == expected[2]
        assert np.array_equal(wandering, expected[3])
        were_cut.add(is_cut)
    assert True in were_cut


def test_a_bias_that_wanders_many_steps_at_once_is_the_one_that_takes_them_one_by_one():
    one = GaussMarkovBias((0.3, 0.3, 0.3), 20.0, 0.5, stream(1, "walk"))
    rng, wandering, biases = stream(1, "walk"), np.zeros(3), np.empty((5, 3))
    rng.standard_normal(3)  # the constant, which is 0 here
    powers = decay_factor(0.5, 20.0) ** np.arange(1, 6)
    for _ in range(3):
        advance_bias_inplace(wandering, increment_std(0.5, 0.3, 20.0), powers, rng.standard_normal((5, 3)), biases)
        assert biases == pytest.approx(np.array([one.step() for _ in range(5)]))
