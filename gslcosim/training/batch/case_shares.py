"""Which case a search draws: all equally often, or by weights."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import UsageError

_N_DRAWN = 2**32


def shares_of_cases(weights: Any, n_cases: int) -> NDArray[np.float64] | None:
    """Return the shares of cases, summed up, (n_cases,); nothing where all come equally often.

    Args:
        weights: One for each case, not negative, not all 0; or None.
        n_cases: How many cases.

    Raises:
        UsageError: the weights are not such numbers.
    """
    if weights is None:
        return None
    given = np.asarray(weights, np.float64)
    if given.shape != (n_cases,) or not np.isfinite(given).all() or given.min() < 0 or not given.sum() > 0:
        raise UsageError(
            f"reset: options: weights: expected {n_cases} numbers from 0, one for each case, not all 0, was "
            f"{weights!r}."
        )
    sums = np.cumsum(given)
    shares = sums / sums[-1]
    # Rounding must not let the last case that comes end below 1.
    shares[np.flatnonzero(given)[-1] :] = 1.0
    return shares


def case_of(drawn: int, n_cases: int, shares: NDArray[np.float64] | None) -> int:
    """Return the case that a random whole number below 2^32 stands for; see `shares_of_cases`."""
    if shares is None:
        return drawn % n_cases
    return int(np.searchsorted(shares, drawn / _N_DRAWN, side="right"))
