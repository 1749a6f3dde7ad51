"""What an inertial measurement unit makes of a tick: wandering biases, lever arm, samples, noise and limits."""
# pyright: basic

import numba
import numpy as np


@numba.njit(cache=True, nogil=True)
def wander_inplace(wandering, constant, kick, powers, draws):
    """Advance a bias by n steps and return the (n, 3) biases.

    b_i = k^i (b_0 + sum of e_j k^-j over j <= i),  e_j = kick draws_j;   bias = constant + b
    [x] = [x]

    Args:
        wandering: (3,) the part b that wanders; advanced.
        constant: (3,) the part that stays.
        kick: (3,) standard deviation of e.
        powers: (n,) k^1 to k^n, k what a step keeps of b.
        draws: (n, 3) standard normal numbers.

    Held by:
        tests/unit/sensing/test_inertial_kernels.py, tests/unit/sensing/test_navigation_sensors.py
    """
    biases = np.empty_like(draws)
    for a in range(3):
        pushed = 0.0
        for i in range(draws.shape[0]):
            pushed += kick[a] * draws[i, a] / powers[i]
            biases[i, a] = constant[a] + powers[i] * (wandering[a] + pushed)
        wandering[a] = powers[-1] * (wandering[a] + pushed)
    return biases


@numba.njit(cache=True, nogil=True)
def _crossed(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, nogil=True)
def _felt_at(row, arm_m):
    # Specific force and angular velocity at a mount, from those and the angular acceleration at the body's origin.
    omega, alpha = (row[3], row[4], row[5]), (row[6], row[7], row[8])
    inwards, sideways = _crossed(omega, _crossed(omega, arm_m)), _crossed(alpha, arm_m)
    f_x, f_y, f_z = row[0] + inwards[0], row[1] + inwards[1], row[2] + inwards[2]
    return f_x + sideways[0], f_y + sideways[1], f_z + sideways[2], row[3], row[4], row[5]


@numba.njit(cache=True, nogil=True)
def inertial_samples(inertial, n, arm_m, force_bias, rate_bias, noise, draws, limit):
    """Return the samples of a tick, their means, and whether any was cut at the limits.

    sample = mean of (f + omega x (omega x r) + alpha x r, omega) over its rows + bias + noise draws, within +- limit
    [m/s^2], [rad/s]; r mount in the body frame

    Args:
        inertial: (n_rows, 9) specific force, angular velocity and angular acceleration at the body's origin, in its
            axes; a row for each physics step.
        n: Number of samples, a divisor of n_rows.
        arm_m: (3,) r, the mount in the body frame [m].
        force_bias: (n, 3) bias of the accelerometer [m/s^2].
        rate_bias: (n, 3) bias of the gyroscope [rad/s].
        noise: (6,) standard deviation of a sample's noise [m/s^2], [rad/s].
        draws: (n, 6) standard normal numbers.
        limit: (6,) ends of the ranges [m/s^2], [rad/s].

    Returns:
        (n, 6) samples, (6,) means of them, whether any was cut.

    Held by:
        tests/unit/sensing/test_inertial_kernels.py (the same in plain numpy, to the bit)
    """
    n_rows = inertial.shape[0] // n
    samples, means, is_cut = np.empty((n, 6)), np.zeros(6), False
    felt = np.empty(6)
    for i in range(n):
        for row in range(i * n_rows, (i + 1) * n_rows):
            parts = _felt_at(inertial[row], arm_m)
            for a in range(6):
                felt[a] = parts[a] if row == i * n_rows else felt[a] + parts[a]
        for a in range(6):
            bias = force_bias[i, a] if a < 3 else rate_bias[i, a - 3]
            value = felt[a] / n_rows + bias + noise[a] * draws[i, a]
            samples[i, a] = min(max(value, -limit[a]), limit[a])
            is_cut |= samples[i, a] != value
            means[a] += samples[i, a]
    return samples, means / n, is_cut
