"""Likelihoods of readings for many sets of source terms at once: two plumes, two sensors, all in logarithms."""
# pyright: basic

import math

import numba
import numpy as np

# Columns of a set of source terms.
X, Y, Z, RATE, SPEED, DIRECTION, DIFFUSIVITY, LIFETIME = range(8)
N_TERMS = 8
# Plumes and sensors by number.
ISOTROPIC, GAUSSIAN_PLUME = range(2)
NORMAL, LOG_NORMAL = range(2)
LEAST_LOG = -700.0
LEAST_AMOUNT = 1e-300
_LOG_SQRT_2_PI = 0.9189385332046727


@numba.njit(cache=True)
def isotropic_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m):
    """Return the mean amount at a place from a source whose gas diffuses, drifts and decays in open space.

    C = Q / (4 pi D d) exp( u (x - s).e / (2 D) - d / lambda ),  lambda = sqrt(D tau / (1 + u^2 tau / (4 D)))
    [ppm] = [ppm m3/s] / ([m2/s] [m]);  e unit vector where the air goes, d = max(|x - s|, a), u = u_k U

    Args:
        terms: (8,) x, y, z of the source s [m], rate Q [ppm m3/s], wind factor U [1], angle added to the wind's
            direction [rad], diffusivity D [m2/s], lifetime tau [s].
        place_m: (3,) place x of the measurement, world frame [m].
        speed_m_s: Wind speed u_k that was measured there [m/s]; 1: U is the speed.
        direction_rad: Direction it goes to, counter-clockwise from +x [rad]; 0: the angle is the direction.
        source_radius_m: Radius a within which the amount is that at its edge [m].

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464, supplement; as a source-term model: Hutchinson,
        Liu, Chen 2018, Information Fusion 42.
    Held by:
        tests/unit/search/bayes/test_source_terms.py (the differential equation; downwind is more than upwind)
    """
    speed_m_s *= terms[SPEED]
    angle_rad = direction_rad + terms[DIRECTION]
    dx_m, dy_m, dz_m = place_m[0] - terms[X], place_m[1] - terms[Y], place_m[2] - terms[Z]
    distance_m = max(math.sqrt(dx_m * dx_m + dy_m * dy_m + dz_m * dz_m), source_radius_m)
    along_m = dx_m * math.cos(angle_rad) + dy_m * math.sin(angle_rad)
    d, tau = terms[DIFFUSIVITY], terms[LIFETIME]
    length_m = math.sqrt(d * tau / (1.0 + speed_m_s * speed_m_s * tau / (4.0 * d)))
    exponent = along_m * speed_m_s / (2.0 * d) - distance_m / length_m
    return terms[RATE] / (4.0 * math.pi * d * distance_m) * math.exp(max(LEAST_LOG, exponent))


@numba.njit(cache=True)
def gaussian_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m):
    """Return the mean amount downwind of a source above a floor at z = 0 that reflects; upwind there is none.

    C = Q / (2 pi u s^2) exp(-y^2 / (2 s^2)) (exp(-(z - h)^2 / (2 s^2)) + exp(-(z + h)^2 / (2 s^2)))
    s^2 = a^2 + 2 D r / u        r distance downwind, y across, z and h heights of the place and of the source
    [ppm] = [ppm m3/s] / ([m/s] [m2]),  [m2] = [m2] + [m2/s] [m] / [m/s]

    Arguments as in `isotropic_plume`; the lifetime is left out, a is the plume's deviation at the source.

    Source:
        The textbook plume (Sutton 1932) with one deviation s for both axes, from the diffusivity.
    Held by:
        tests/unit/search/bayes/test_source_terms.py (the flux through any plane downwind is Q)
    """
    speed_m_s *= terms[SPEED]
    angle_rad = direction_rad + terms[DIRECTION]
    dx_m, dy_m = place_m[0] - terms[X], place_m[1] - terms[Y]
    along_m = dx_m * math.cos(angle_rad) + dy_m * math.sin(angle_rad)
    if along_m <= 0.0 or speed_m_s <= 0.0:
        return 0.0
    across_m = dy_m * math.cos(angle_rad) - dx_m * math.sin(angle_rad)
    variance_m2 = source_radius_m * source_radius_m + 2.0 * terms[DIFFUSIVITY] * along_m / speed_m_s
    below_m, above_m = place_m[2] - terms[Z], place_m[2] + terms[Z]
    vertical = math.exp(-0.5 * below_m * below_m / variance_m2) + math.exp(-0.5 * above_m * above_m / variance_m2)
    horizontal = math.exp(-0.5 * across_m * across_m / variance_m2)
    return terms[RATE] / (2.0 * math.pi * speed_m_s * variance_m2) * horizontal * vertical


@numba.njit(cache=True)
def log_likelihood_of_reading(reading, amount, threshold, noise_frac, noise_floor, detection_probability, sensor):
    """Return the logarithm of the likelihood of one reading, given the mean amount.

    NORMAL:      above the threshold  P_d N(z; C, (f C + e)^2)
                 else                 P_d / 2 (1 + erf((thr - C) / (thr sqrt 2))) + 1 - P_d
    LOG_NORMAL:  above the threshold  P_d N(ln z; ln C, f^2) / z
                 else                 P_d / 2 (1 + erf((ln thr - ln C) / (f sqrt 2))) + 1 - P_d
    z, C, thr, e in one unit, f and P_d without one; the density of z has that unit's inverse

    Args:
        reading: z; at most the threshold where nothing was detected.
        amount: C.
        threshold: thr, > 0.
        noise_frac: f, noise per amount.
        noise_floor: e, noise at no amount (NORMAL).
        detection_probability: P_d: 1 - P_d is the chance to miss what is there.
        sensor: NORMAL or LOG_NORMAL.

    Source:
        NORMAL: Hutchinson, Liu, Chen 2018 as in AutoSTE [C]. LOG_NORMAL: zero-inflated, ours.
    Deviation:
        P_d is a factor of detections, too: it does not depend on the source and changes nothing.
    Held by:
        tests/unit/search/bayes/test_source_terms.py
    """
    if sensor == NORMAL:
        if reading <= threshold:
            chance = 0.5 * math.erfc((amount - threshold) / (threshold * math.sqrt(2.0)))
            return math.log(max(LEAST_AMOUNT, detection_probability * chance + 1.0 - detection_probability))
        sigma = noise_frac * amount + noise_floor
        off = (reading - amount) / sigma
        return math.log(detection_probability) - 0.5 * off * off - math.log(sigma) - _LOG_SQRT_2_PI
    log_amount = math.log(max(LEAST_AMOUNT, amount))
    if reading <= threshold:
        chance = 0.5 * math.erfc((log_amount - math.log(threshold)) / (noise_frac * math.sqrt(2.0)))
        return math.log(max(LEAST_AMOUNT, detection_probability * chance + 1.0 - detection_probability))
    off = (math.log(reading) - log_amount) / noise_frac
    return math.log(detection_probability) - 0.5 * off * off - math.log(noise_frac) - _LOG_SQRT_2_PI - math.log(reading)


@numba.njit(cache=True)
def mean_amount(terms, place_m, speed_m_s, direction_rad, source_radius_m, plume):
    """Return the mean amount by the plume of that number, ISOTROPIC or GAUSSIAN_PLUME; see there."""
    if plume == ISOTROPIC:
        return isotropic_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m)
    return gaussian_plume(terms, place_m, speed_m_s, direction_rad, source_radius_m)


@numba.njit(cache=True)
def log_likelihoods(terms, place_m, wind, reading, plume, sensor, figures):
    """Return the logarithm of the likelihood of all readings together, for each set of terms.

    Args:
        terms: (n, 8) sets of source terms; see `isotropic_plume`.
        place_m: (k, 3) places of the readings, world frame [m].
        wind: (k, 2) speed [m/s] and direction it goes to [rad] at each reading.
        reading: (k,) what was read [ppm].
        plume: ISOTROPIC or GAUSSIAN_PLUME.
        sensor: NORMAL or LOG_NORMAL.
        figures: (5,) threshold [ppm], noise per amount, noise at none [ppm], detection probability, source radius [m].

    Returns:
        (n,).

    Held by:
        tests/unit/search/bayes/test_source_terms.py
    """
    n, k = terms.shape[0], reading.shape[0]
    total = np.zeros(n)
    for i in range(n):
        for j in range(k):
            amount = mean_amount(terms[i], place_m[j], wind[j, 0], wind[j, 1], figures[4], plume)
            total[i] += log_likelihood_of_reading(
                reading[j], amount, figures[0], figures[1], figures[2], figures[3], sensor
            )
    return total


@numba.njit(cache=True)
def sampled_reading(amount, uniform, normal, threshold, noise_frac, noise_floor, detection_probability, sensor):
    """Return a reading as the sensor of `log_likelihood_of_reading` gives it; 0 where nothing is detected.

    Args:
        amount: The mean amount.
        uniform: A number uniform in [0, 1): below P_d the sensor works.
        normal: A standard normal number.
        threshold: What is detected.
        noise_frac: Noise per amount.
        noise_floor: Noise at no amount (NORMAL).
        detection_probability: P_d.
        sensor: NORMAL or LOG_NORMAL.

    Held by:
        tests/unit/search/bayes/test_source_terms.py
    """
    if uniform >= detection_probability:
        return 0.0
    if sensor == NORMAL:
        reading = amount + (noise_frac * amount + noise_floor) * normal
    else:
        reading = max(LEAST_AMOUNT, amount) * math.exp(noise_frac * normal)
    return reading if reading > threshold else 0.0


@numba.njit(cache=True)
def expected_gain_bits(terms, place_m, wind, truth, uniform, normal, plume, sensor, figures):
    """Return how many bits a reading at each of several places is expected to tell of the source terms.

    gain(x) = mean over t of KL(w | z_t),  z_t a reading at x if terms t were true,  w_i ~ p(z_t | terms i)
    KL = sum over i of w_i log2(n w_i)        [bit]

    Args:
        terms: (n, 8) equally likely sets of terms.
        place_m: (k, 3) candidate places, world frame [m].
        wind: (2,) speed [m/s] and direction it goes to [rad], taken for all of them.
        truth: (m,) indices t of the sets that are taken for true in turn.
        uniform: (m,) numbers in [0, 1) for their readings.
        normal: (m,) standard normal numbers for their readings.
        plume: ISOTROPIC or GAUSSIAN_PLUME.
        sensor: NORMAL or LOG_NORMAL.
        figures: As in `log_likelihoods`.

    Returns:
        (k,), none negative.

    Source:
        The reward of AutoSTE: Kullback-Leibler divergence, one draw each from 25 particles [C].
    Held by:
        tests/unit/search/bayes/test_source_terms.py
    """
    n, k, m = terms.shape[0], place_m.shape[0], truth.shape[0]
    gain = np.zeros(k)
    amount = np.empty(n)
    log_weight = np.empty(n)
    for a in range(k):
        for i in range(n):
            amount[i] = mean_amount(terms[i], place_m[a], wind[0], wind[1], figures[4], plume)
        for t in range(m):
            reading = sampled_reading(
                amount[truth[t]], uniform[t], normal[t], figures[0], figures[1], figures[2], figures[3], sensor
            )
            for i in range(n):
                log_weight[i] = log_likelihood_of_reading(
                    reading, amount[i], figures[0], figures[1], figures[2], figures[3], sensor
                )
            gain[a] += _divergence_bits(log_weight) / m
    return gain


@numba.njit(cache=True)
def _divergence_bits(log_weight):
    n, highest = log_weight.shape[0], log_weight.max()
    total, mean = 0.0, 0.0
    for i in range(n):
        weight = math.exp(log_weight[i] - highest)
        total += weight
        mean += weight * (log_weight[i] - highest)
    return max(0.0, (mean / total - math.log(total) + math.log(n)) / math.log(2.0))


@numba.njit(cache=True)
def log_first_arrival(time_s, distance_m, speed_m_s, diffusivity_m2_s):
    """Return the logarithm of the density of the time at which gas first comes to a place after its release.

    f(t) = d / sqrt(4 pi D t^3) exp(-(d - u t)^2 / (4 D t))        [1/s] = [m] / sqrt([m2/s] [s3])

    With u > 0 its mean is d / u, its variance 2 D d / u^3; for a gust or the start of a source.

    Args:
        time_s: t since the release [s].
        distance_m: d, along the wind [m].
        speed_m_s: u [m/s].
        diffusivity_m2_s: D [m2/s].

    Returns:
        Minus infinity for times that are not positive.

    Source:
        Schroedinger 1915: first passage of Brownian motion with drift, the inverse Gaussian distribution.
    Held by:
        tests/unit/search/bayes/test_source_terms.py (its integral is 1, its mean d / u)
    """
    if time_s <= 0.0:
        return -math.inf
    off_m = distance_m - speed_m_s * time_s
    spread_m2 = 4.0 * diffusivity_m2_s * time_s
    return math.log(distance_m / time_s) - 0.5 * math.log(math.pi * spread_m2) - off_m * off_m / spread_m2
