"""What detections and their absence say of many possible places of the source at once."""
# pyright: basic

import math

import numba
import numpy as np

# Beyond this exponent, 2e-9, a puff changes no weight that matters.
FARTHEST_EXPONENT = 20.0
LEAST_PRODUCT = 1e-300


@numba.njit(cache=True)
def log_miss_of_particles(place_m, sensor_m, displacement_m, variance_m2, detection_probability, sensed_m2):
    """Return the logarithm of the chance to detect nothing, for a source at each particle.

    ln gamma(s) = sum over l of ln(1 - min(1, mu S N(x - s; V(l), diag(v_x(l), v_y(l)))))
    [1] = [m2] [1/m2]; x sensor, V(l) and v(l) displacement and variance of the puff released at time l

    Args:
        place_m: (n, 2) places s of particles, world frame [m].
        sensor_m: (2,) place x of the measurement, world frame [m].
        displacement_m: (n_puffs, 2) how far the wind has carried each puff, world frame [m].
        variance_m2: (n_puffs, 2) variance of each puff's random displacement, by axis [m2], > 0.
        detection_probability: mu, from 0 to 1.
        sensed_m2: Area S in which the sensor meets a puff [m2].

    Returns:
        (n,) logarithms; that of a detection is ln(1 - exp(ln gamma)), see `log_hit`.

    Source:
        Li, Meng, Wang, Zeng 2011, Odor source localization using a mobile robot in outdoor airflow environments with
        a particle filter algorithm, Autonomous Robots 30, 281 (weights as in the MAPIR group's public code [C]).
    Deviation:
        mu S N is kept below 1, which small puffs would exceed.
    Held by:
        tests/unit/search/bayes/test_particle_filter.py
    """
    n, n_puffs = place_m.shape[0], displacement_m.shape[0]
    log_miss = np.empty(n)
    centre_m = np.empty((n_puffs, 2))
    half_per_m2 = np.empty((n_puffs, 2))
    height = np.empty(n_puffs)
    for k in range(n_puffs):
        area_m2 = math.sqrt(variance_m2[k, 0] * variance_m2[k, 1])
        height[k] = detection_probability * sensed_m2 / (2.0 * math.pi * area_m2)
        for axis in range(2):
            centre_m[k, axis] = sensor_m[axis] - displacement_m[k, axis]
            half_per_m2[k, axis] = 0.5 / variance_m2[k, axis]
    for p in range(n):
        product = 1.0
        for k in range(n_puffs):
            dx_m, dy_m = place_m[p, 0] - centre_m[k, 0], place_m[p, 1] - centre_m[k, 1]
            exponent = dx_m * dx_m * half_per_m2[k, 0] + dy_m * dy_m * half_per_m2[k, 1]
            if exponent < FARTHEST_EXPONENT:
                product = max(LEAST_PRODUCT, product * (1.0 - min(1.0, height[k] * math.exp(-exponent))))
        log_miss[p] = math.log(product)
    return log_miss


@numba.njit(cache=True)
def systematic_indices(weight, offset):
    """Return which particles go on, each about as often as its weight says.

    Particle i is taken for each k with  sum of w up to i - 1  <=  (k + u) / n  <  sum of w up to i        u offset
    Each is taken floor(n w) or ceil(n w) times.

    Args:
        weight: (n,) weights, none negative, sum 1.
        offset: u, uniform in [0, 1).

    Returns:
        (n,) int64 indices, ascending.

    Source:
        Kitagawa 1996, Monte Carlo filter and smoother, doi:10.1080/10618600.1996.10474692.
    Held by:
        tests/unit/search/bayes/test_particle_filter.py
    """
    n = weight.shape[0]
    index = np.empty(n, np.int64)
    i, total = 0, weight[0]
    for k in range(n):
        while total <= (k + offset) / n and i < n - 1:
            i += 1
            total += weight[i]
        index[k] = i
    return index
