"""Audits: how many rows of a table can still be false after some of them were drawn and checked.

Rows are drawn without replacement, so the number of false ones among those drawn is hypergeometric. All figures are
exact: whole numbers are compared, nothing is rounded.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from math import comb

from gslcosim.base.errors import ShapeError
from gslcosim_archive.signing.submission_log import LogLine, list_own, list_submissions
from gslcosim_bench.execution.verification import draw_trials
from gslcosim_bench.statistics.estimates import LEVEL


@dataclass(frozen=True, kw_only=True)
class AuditDraw:
    """The draw of an audit, and what of the log it follows from.

    Attributes:
        of_suite: All lines of the log for the suite's cases; the first one decides, with the beacon, what is drawn.
        own: Those of the author: of the same key, or with the same name beside another.
        n_lines: Lines whose limits hold together.
        level: Of each of these limits.
        places: Drawn places, in the order of the draw.
    """

    of_suite: Sequence[LogLine]
    own: Sequence[LogLine]
    n_lines: int
    level: float
    places: Sequence[str]


def draw_audit(
    lines: Sequence[LogLine],
    submission: LogLine,
    places: Collection[str],
    beacon: str,
    *,
    n_places: int | None = None,
    max_false_share: float = 0.05,
    counts_all_keys: bool = False,
) -> AuditDraw:
    """Return which places of a submission an audit repeats.

    seed = hash of the suite's first line in the log, by whatever key / beacon

    Nothing of it is the author's to choose: the beacon is unknown when that line is written, places have neither
    programs nor entries in them, and another line or key changes nothing. What many lines do give is many tries at
    which rows are false. So the draw is as large as makes its limit hold for all lines of an author together.

    Args:
        places: Of the submission, as `RepeatableResults.list_places` has them.
        beacon: A public value from after the submission.
        n_places: How many are drawn; absent: as many as rule out that more than `max_false_share` of them are false.
        counts_all_keys: Whether all keys for the suite count as one author's.

    Held by:
        extensions/archive/tests/unit/test_audit_draws.py (misses among 100 lines, several keys, and other orders)
    """
    of_suite, own = list_submissions(lines, submission), list_own(lines, submission)
    n_lines = len(of_suite if counts_all_keys else own)
    level = level_of_lines(n_lines)
    n = n_places or required_draw(len(places), max_false_share, level)
    drawn = draw_trials(places, n, seed=f"{of_suite[0].hash}\n{beacon}")
    return AuditDraw(of_suite=of_suite, own=own, n_lines=n_lines, level=level, places=drawn)


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


def max_false_rows_in_places(
    n_rows: Sequence[int], n_drawn: int, n_found: int, n_false: int, level: float = LEVEL
) -> int:
    """Return the largest number of false rows that a draw of whole places leaves possible at a level.

    A place with a false row is a false place. The limit is of these: what was drawn has the false rows that were found,
    and the others could have nothing but false rows, the fullest first.

    Args:
        n_rows: Rows of each place that was not drawn.
        n_drawn: Places that were drawn, all of their rows with them.
        n_found: Those among them with a false row.
        n_false: False rows that were found.
    """
    n_left = max_false_rows(len(n_rows) + n_drawn, n_drawn, n_found, level) - n_found
    return n_false + sum(sorted(n_rows, reverse=True)[:n_left])


def level_of_lines(n_lines: int, level: float = LEVEL) -> float:
    """Return the level of each audit with which the limits of so many submissions hold together (Bonferroni).

    Who hands in many variants, each false elsewhere, would otherwise find one among them that a draw misses.
    """
    if n_lines < 1:
        raise ShapeError(f"level_of_lines: expected at least one line, was {n_lines}.")
    return 1.0 - (1.0 - level) / n_lines


@cache
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
