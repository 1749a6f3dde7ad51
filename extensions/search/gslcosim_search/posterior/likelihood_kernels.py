# pyright: basic

"""Kernels of the likelihood of a source's place and rate, given a reading, by tables over ln(mean level).

A table has an entry for each mean level c, ln(c) one step apart. A place has the entry of its level for a source of the
least rate; each further rate is `rates_apart` entries on.
"""

import math

import numba
import numpy as np

from gslcosim_search import elementary

# Peak of the density of Student's t with three degrees of freedom.
T3_PEAK = 2.0 / (math.pi * math.sqrt(3.0))
# A probability below this tells nothing of what is expected.
_LEAST_PROBABILITY = 1e-9


@numba.njit(cache=True, nogil=True)
def find_entries_inplace(level, least, entries_per_nat, entries):
    """Set each place's entry from its mean level for a source of rate 1, `least` added: gas that comes otherwise."""
    for i in range(level.size):
        entries[i] = 0
        if level[i] > 0.0:
            entries[i] = int(entries_per_nat * elementary.log1p(level[i] / least) + 0.5)


@numba.njit(cache=True, nogil=True)
def add_log_likelihood_inplace(entries, table, rates_apart, log_likelihood):
    """Add the logarithm of a reading's likelihood: (n, n_rates) sums, from (n,) entries and the (m,) table of it."""
    for i in range(entries.size):
        for k in range(log_likelihood.shape[1]):
            log_likelihood[i, k] += table[min(entries[i] + rates_apart * k, table.size - 1)]


@numba.njit(cache=True, nogil=True)
def tabulate_gas_inplace(log_ratio, step, spread, miss_chance, stray_density, table):
    """Fill the table of a level with gas: ln((1 - m) t3((ln(level / mean)) / s) / s + f).

    Args:
        log_ratio: ln(level / mean level of the first entry).
        step: ln(mean level) from an entry to the next.
        spread: Spread s of ln(level) around ln(mean level).
        miss_chance: Chance m that a plume that passes is missed.
        stray_density: Density f of gas from elsewhere.
        table: (m,) numbers, overwritten.
    """
    for i in range(table.size):
        ratio = (log_ratio - i * step) / spread
        tail = 1.0 + ratio * ratio / 3.0
        table[i] = elementary.log((1.0 - miss_chance) * T3_PEAK / (spread * tail * tail) + stray_density)


@numba.njit(cache=True, nogil=True)
def tabulate_detection_inplace(log_ratio, step, steepness, miss_chance, table):
    """Fill the table of a detection's chance: (1 - m) (1 - 1 / (1 + (mean / threshold)^g)).

    Args:
        log_ratio: ln(threshold / mean level of the first entry).
        step: ln(mean level) from an entry to the next.
        steepness: Exponent g.
        miss_chance: Chance m that a plume that passes is missed.
        table: (m,) numbers, overwritten.
    """
    for i in range(table.size):
        below = 1.0 / (1.0 + elementary.exp(min(steepness * (i * step - log_ratio), 60.0)))
        table[i] = (1.0 - miss_chance) * (1.0 - below)


@numba.njit(cache=True, nogil=True)
def weigh_inplace(log_likelihood, weight, least_log, probability):
    """Set (n, n_rates) probabilities, in proportion to exp(w L), sum 1; what is below exp(least) of the most is 0."""
    top = log_likelihood[0, 0]
    for i in range(log_likelihood.shape[0]):
        for k in range(log_likelihood.shape[1]):
            top = max(top, log_likelihood[i, k])
    total = 0.0
    for i in range(log_likelihood.shape[0]):
        for k in range(log_likelihood.shape[1]):
            exponent = weight * (log_likelihood[i, k] - top)
            probability[i, k] = elementary.exp(exponent) if exponent > least_log else 0.0
            total += probability[i, k]
    for i in range(log_likelihood.shape[0]):
        for k in range(log_likelihood.shape[1]):
            probability[i, k] /= total


@numba.njit(cache=True, nogil=True)
def expected_information_nats(entries, detection, rates_apart, probability):
    """Return the mutual information of the source and whether the next reading shows gas [nat].

    I = h(sum over places and rates of p d) - sum over them of p h(d),  h(q) = -q ln q - (1 - q) ln(1 - q)

    Args:
        entries: (n,) entry of each place, as `find_entries_inplace` sets it.
        detection: (m,) chance d of a detection in each entry.
        rates_apart: Entries from a rate to the next.
        probability: (n, n_rates) probability p of each place and rate, sum 1.

    Source:
        The rate of information of Vergassola, Villermaux, Shraiman 2007, doi:10.1038/nature05464, for one reading.
    Held by:
        extensions/search/tests/unit/posterior/test_source_posterior.py
    """
    entropy = np.empty(detection.size)
    for i in range(detection.size):
        entropy[i] = _binary_entropy(detection[i])
    chance, left = 0.0, 0.0
    for i in range(entries.size):
        for k in range(probability.shape[1]):
            if probability[i, k] > _LEAST_PROBABILITY:
                entry = min(entries[i] + rates_apart * k, detection.size - 1)
                chance += probability[i, k] * detection[entry]
                left += probability[i, k] * entropy[entry]
    return max(0.0, _binary_entropy(chance) - left)


@numba.njit(cache=True, nogil=True, inline="always")
def _binary_entropy(chance):
    if not _LEAST_PROBABILITY < chance < 1.0 - _LEAST_PROBABILITY:
        return 0.0
    return -(chance * elementary.log(chance) + (1.0 - chance) * elementary.log(1.0 - chance))
