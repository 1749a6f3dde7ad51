"""Samples of an inertial measurement unit in a tick: lever arm, biases, noise and limits."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, nogil=True)
def transfer_to_mount_inplace(inertial, arm_m, samples):
    """Write what is felt at a mount: specific force and angular velocity, means over the rows of each sample.

    f = f_0 + omega x (omega x r) + alpha x r
    [m/s^2]; r mount in the body frame

    Args:
        inertial: (n_rows, 9) specific force [m/s^2], angular velocity [rad/s] and angular acceleration [rad/s^2] at the
            origin of the body frame, in its axes; a row for each physics step.
        arm_m: (3,) r, the mount in the body frame [m].
        samples: (n, 6) written; n divides n_rows.

    Held by:
        tests/unit/services/sensing/models/test_imu_kernels.py
    """
    n_rows = inertial.shape[0] // samples.shape[0]
    samples[:] = 0.0
    for i in range(samples.shape[0]):
        for row in inertial[i * n_rows : (i + 1) * n_rows]:
            omega, alpha = (row[3], row[4], row[5]), (row[6], row[7], row[8])
            inwards, sideways = _cross(omega, _cross(omega, arm_m)), _cross(alpha, arm_m)
            for a in range(3):
                samples[i, a] += row[a] + inwards[a] + sideways[a]
                samples[i, 3 + a] += row[3 + a]
    samples /= n_rows


@numba.njit(cache=True, nogil=True)
def advance_bias_inplace(wandering, kick, powers, draws, biases):
    """Advance a bias in three axes by n steps and write it after each.

    b_i = k^i (b_0 + sum of e_j k^-j over j <= i),  e_j = kick draws_j
    [x]

    Args:
        wandering: (3,) b; advanced.
        kick: Standard deviation of e.
        powers: (n,) k^1 to k^n, k what a step keeps of b.
        draws: (n, 3) standard normal numbers.
        biases: (n, 3) written.

    Held by:
        tests/unit/services/sensing/models/test_imu_kernels.py
    """
    n = draws.shape[0]
    for a in range(3):
        pushed = 0.0
        for i in range(n):
            pushed += kick * draws[i, a] / powers[i]
            biases[i, a] = powers[i] * (wandering[a] + pushed)
        wandering[a] = biases[n - 1, a]


@numba.njit(cache=True, nogil=True)
def sample_imu(inertial, arm_m, constant, wandering, kick, powers, noise, limit, draws):
    """Return the samples of a tick, their means, and whether any was cut at the limits.

    sample = felt + constant + wandering bias + noise N(0, 1), within +- limit
    [m/s^2], [rad/s]

    Args:
        inertial: (n_rows, 9), see `transfer_to_mount_inplace`.
        arm_m: (3,) the mount in the body frame [m].
        constant: (6,) biases that stay [m/s^2], [rad/s].
        wandering: (6,) biases that wander [m/s^2], [rad/s]; advanced by n steps.
        kick: (2,) of accelerometer and gyroscope, see `advance_bias_inplace`.
        powers: (2, n) of accelerometer and gyroscope, see `advance_bias_inplace`; n divides n_rows.
        noise: (6,) standard deviation of a sample's noise [m/s^2], [rad/s].
        limit: (6,) ends of the ranges [m/s^2], [rad/s].
        draws: (12 n,) standard normal numbers: for the accelerometer's bias, for the gyroscope's, for the noise.

    Returns:
        (n, 6) samples, their six means, whether any was cut.

    Held by:
        tests/unit/services/sensing/models/test_imu_kernels.py (the same in plain numpy, to the bit)
    """
    n = powers.shape[1]
    samples, biases = np.empty((n, 6)), np.empty((n, 6))
    transfer_to_mount_inplace(inertial, arm_m, samples)
    for half in range(2):
        axes, own = slice(3 * half, 3 * half + 3), draws[3 * n * half : 3 * n * (half + 1)].reshape(n, 3)
        advance_bias_inplace(wandering[axes], kick[half], powers[half], own, biases[:, axes])
    is_cut, sums = False, np.zeros(6)
    for i in range(n):
        for a in range(6):
            value = samples[i, a] + (constant[a] + biases[i, a]) + noise[a] * draws[6 * n + 6 * i + a]
            samples[i, a] = min(max(value, -limit[a]), limit[a])
            is_cut |= samples[i, a] != value
            sums[a] += samples[i, a]
    means = (sums[0] / n, sums[1] / n, sums[2] / n, sums[3] / n, sums[4] / n, sums[5] / n)
    return samples, means, is_cut
