"""Audits: how many rows of a table can still be false after some of them were drawn and checked.

Rows are drawn without replacement, so the number of false ones among those drawn is hypergeometric. All figures are
exact: whole numbers are compared, nothing is rounded.
"""

from fractions import Fraction
from math import comb

from gslcosim.base.errors import ShapeError
from gslcosim_bench.statistics.estimates import LEVEL


def detection_probability(n_rows: int, n_false: int, n_drawn: int) -> float:
    """Return the probability that a draw has a false row.

    1 - C(N - K, n) / C(N, n)        N n_rows, K n_false, n n_drawn

    Args:
        n_false: False ones among them, 0 to n_rows.
        n_drawn: Rows that are drawn without replacement, 0 to n_rows.
    """
    _check_counts(n_rows, n_drawn, n_false)
    return 1.0 - comb(n_rows - n_false, n_drawn) / comb(n_rows, n_drawn)


def max_false_rows(n_rows: int, n_drawn: int, n_found: int, level: float = LEVEL) -> int:
    """Return the largest number of false rows that a draw leaves possible at a level.

    The largest K with P(X <= k) > 1 - level, X hypergeometric(N, K, n)        k n_found

    It is an upper limit that covers the true number in at least `level` of draws, whatever that number is.

    Args:
        n_drawn: Rows that were drawn without replacement, 0 to n_rows.
        n_found: False ones among those, 0 to n_drawn.

    Source:
        The exact one-sided limit of a finite population, as Clopper and Pearson 1934, doi:10.1093/biomet/26.4.404,
        with the hypergeometric distribution for the binomial.
    Held by:
        extensions/bench/tests/unit/statistics/test_audits.py (scipy; simulated draws)
    """
    _check_counts(n_rows, n_drawn, 0)
    _check_counts(n_drawn, n_found, 0)
    low, high = n_found, n_rows - (n_drawn - n_found)
    while low < high:
        middle = (low + high + 1) // 2
        if _is_possible(n_rows, middle, n_drawn, n_found, level):
            low = middle
        else:
            high = middle - 1
    return low


def required_draw(n_rows: int, max_false_share: float, level: float = LEVEL) -> int:
    """Return how many rows to draw so that, if none of them is false, at most a share of all can be.

    Args:
        n_rows: Rows of the table, at least 1.
        max_false_share: The share, 0 or more and below 1; with 0 no row may be false.
    """
    if n_rows < 1 or not 0.0 <= max_false_share < 1.0:
        raise ShapeError(f"required_draw: expected rows and a share from 0 to 1, was {n_rows} and {max_false_share}.")
    n_too_many = int(Fraction(str(max_false_share)) * n_rows) + 1
    low, high = 1, n_rows
    while low < high:
        middle = (low + high) // 2
        if n_too_many > n_rows - middle or not _is_possible(n_rows, n_too_many, middle, 0, level):
            high = middle
        else:
            low = middle + 1
    return low


def _is_possible(n_rows: int, n_false: int, n_drawn: int, n_found: int, level: float) -> bool:
    ways = sum(comb(n_false, k) * comb(n_rows - n_false, n_drawn - k) for k in range(n_found + 1))
    return ways > (1 - Fraction(str(level))) * comb(n_rows, n_drawn)


def _check_counts(n_rows: int, n_drawn: int, n_false: int) -> None:
    if not (0 <= n_drawn <= n_rows and 0 <= n_false <= n_rows):
        raise ShapeError(f"counts: expected 0 to {n_rows} rows, was {n_drawn} drawn and {n_false} false.")
