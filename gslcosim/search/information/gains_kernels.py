"""What a searcher would know after a stop elsewhere: figures of the beliefs that each outcome would leave."""
# pyright: basic

import math

import numba
import numpy as np

# Columns of `foresee_into`.
PROBABILITY, ENTROPY_BITS, GAIN_BITS, MANHATTAN_M, SQUARE_M2, VARIANCE_M2, RENYI_BITS = range(7)
N_FIGURES = 7
_PER_LN_2 = 1.0 / math.log(2.0)


@numba.njit(cache=True, nogil=True)
def logs_of_into(p, log_p):
    """Write the natural logarithm of each probability, 0 where the probability is 0 (nothing is weighted by it)."""
    for j in range(p.shape[0]):
        log_p[j] = math.log(p[j]) if p[j] > 0.0 else 0.0


@numba.njit(cache=True, nogil=True)
def foresee_into(p, log_p, likelihood, weight, log_weight, cells_m, places_m, alpha, figures):
    """Write, for each place and each outcome of a stop there, how likely it is and what belief it would leave.

    Z = sum_s p(s) L(s)                                      probability of the outcome, without finding the source
    p'(s) = p(s) W(s) / z,  z = sum_s p(s) W(s)              belief that it leaves
    H = -sum p' log2 p'                                      its entropy [bit]
    G = sum p' log2(p' / p)                                  its divergence from the belief of now [bit]
    M = sum p' |s - x|_1,  S = sum p' |s - x|^2              expected distance along the axes [m], squared distance [m2]
    V = S - |sum p' (s - x)|^2                               its variance, summed over the axes [m2]
    A = log2(sum p'^alpha p^(1 - alpha)) / (alpha - 1)       Renyi divergence [bit]
    [1] = [1] [1]

    Cells that the searcher would find to be the source, or not, have likelihood and weight 0: a found source leaves
    no entropy, and so adds nothing to a sum over outcomes weighted by Z.

    Args:
        p: (c,) belief, sums to 1.
        log_p: (c,) its natural logarithm, 0 where p is 0.
        likelihood: (m, n, c) L, for m places of the searcher and n outcomes.
        weight: (m, n, c) W, equal to L where nothing is tempered.
        log_weight: (m, n, c) natural logarithm of W, 0 where W is 0.
        cells_m: (c, d) centres of the cells s, world frame [m].
        places_m: (m, d) places x of the searcher [m].
        alpha: Order of the Renyi divergence, > 0 and not 1; 0 leaves that figure 0.
        figures: (m, n, N_FIGURES) in the order of the constants above; overwritten. An impossible outcome has zeros.

    Source:
        Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464 (Z, H); Renyi 1961 (A).
    Held by:
        tests/unit/search/information/test_gains.py (numpy, outcome by outcome)
    """
    n_dimensions = cells_m.shape[1]
    offset = np.empty(n_dimensions)
    mean = np.empty(n_dimensions)
    for i in range(likelihood.shape[0]):
        for h in range(likelihood.shape[1]):
            chance, z, z_log_p, z_log_w, manhattan, square, overlap = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            mean[:] = 0.0
            for j in range(p.shape[0]):
                chance += p[j] * likelihood[i, h, j]
                w = p[j] * weight[i, h, j]
                if w == 0.0:
                    continue
                z += w
                z_log_p += w * log_p[j]
                z_log_w += w * log_weight[i, h, j]
                along, across = 0.0, 0.0
                for k in range(n_dimensions):
                    offset[k] = cells_m[j, k] - places_m[i, k]
                    along += abs(offset[k])
                    across += offset[k] * offset[k]
                    mean[k] += w * offset[k]
                manhattan += w * along
                square += w * across
                if alpha == 0.5:
                    overlap += p[j] * math.sqrt(weight[i, h, j])
                elif alpha > 0.0:
                    overlap += p[j] * math.exp(alpha * log_weight[i, h, j])
            figures[i, h, :] = 0.0
            figures[i, h, PROBABILITY] = chance
            if z <= 0.0:
                continue
            log_z = math.log(z)
            centre = 0.0
            for k in range(n_dimensions):
                centre += (mean[k] / z) ** 2
            figures[i, h, ENTROPY_BITS] = max(0.0, (log_z - (z_log_p + z_log_w) / z) * _PER_LN_2)
            figures[i, h, GAIN_BITS] = (z_log_w / z - log_z) * _PER_LN_2
            figures[i, h, MANHATTAN_M] = manhattan / z
            figures[i, h, SQUARE_M2] = square / z
            figures[i, h, VARIANCE_M2] = max(0.0, square / z - centre)
            if alpha > 0.0:
                figures[i, h, RENYI_BITS] = (math.log(overlap) - alpha * log_z) / (alpha - 1.0) * _PER_LN_2


@numba.njit(cache=True, nogil=True)
def remaining_entropy_bits(p, log_p, likelihood, weight, log_weight):
    """Return the entropy that is expected to remain after a stop at one place; a found source leaves none.

    E = sum_h Z_h H_h, as in `foresee_into`
    [bit] = [1] [bit]

    Args:
        p: (c,) belief.
        log_p: (c,) its natural logarithm, 0 where p is 0.
        likelihood: (n, c) probability of each outcome.
        weight: (n, c) what it weighs.
        log_weight: (n, c) natural logarithm of the weight.

    Held by:
        tests/unit/search/information/test_gains.py
    """
    total = 0.0
    for h in range(likelihood.shape[0]):
        chance, z, z_log = 0.0, 0.0, 0.0
        for j in range(p.shape[0]):
            chance += p[j] * likelihood[h, j]
            w = p[j] * weight[h, j]
            z += w
            z_log += w * (log_p[j] + log_weight[h, j])
        if z > 0.0:
            total += chance * max(0.0, math.log(z) - z_log / z)
    return total * _PER_LN_2


@numba.njit(cache=True, nogil=True)
def posterior_into(p, log_p, weight, log_weight, posterior, log_posterior):
    """Write the belief that an outcome leaves, and its logarithm; return z, the sum before scaling.

    p'(s) = p(s) W(s) / z
    [1] = [1] [1]

    Args:
        p: (c,) belief.
        log_p: (c,) its natural logarithm, 0 where p is 0.
        weight: (c,) W.
        log_weight: (c,) natural logarithm of W, 0 where W is 0.
        posterior: (c,) p'; overwritten. All 0 where z is 0.
        log_posterior: (c,) its logarithm, 0 where p' is 0; overwritten.

    Held by:
        tests/unit/search/information/test_gains.py
    """
    z = 0.0
    for j in range(p.shape[0]):
        posterior[j] = p[j] * weight[j]
        z += posterior[j]
    if z <= 0.0:
        posterior[:] = 0.0
        log_posterior[:] = 0.0
        return 0.0
    log_z = math.log(z)
    for j in range(p.shape[0]):
        posterior[j] /= z
        log_posterior[j] = log_p[j] + log_weight[j] - log_z if posterior[j] > 0.0 else 0.0
    return z
