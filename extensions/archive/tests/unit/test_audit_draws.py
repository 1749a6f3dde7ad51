"""Draws of audits against an author with a hundred lines: what is false is found as often as is stated."""

import hashlib
from functools import cache

import numpy as np
import pytest
from scipy import stats

from gslcosim.base.errors import ShapeError
from gslcosim_archive.audits import draw_audit, level_of_lines, max_false_rows_in_places, required_draw
from gslcosim_archive.signing.submission_log import LogLine
from gslcosim_bench.execution.verification import draw_trials

N_PLACES, N_FALSE, N_LINES, N_AUDITS = 240, 16, 100, 60
PLACES = [f"{i:024x} 0 0" for i in range(N_PLACES)]
# Audits of an honest limit that may miss: 5 % of 60, with room for chance.
MOST_MISSES = stats.binom.ppf(0.999, N_AUDITS, 0.05)


def make_lines(key_of=lambda i: "ada", author_of=lambda i: "Ada", suite_of=lambda i: "suite"):
    return [
        LogLine(
            number=i + 1, previous="", kind="submission", key=key_of(i), author=author_of(i), signed_at=str(i),
            suite=suite_of(i), suite_hash="cases", text="", statement_hash="", signature="",
            hash=hashlib.sha256(f"line {i}".encode()).hexdigest(),
        )
        for i in range(N_LINES)
    ]  # fmt: skip


def count_misses(lines, false_of, **options):
    """Return of how many audits any of the lines comes out without a false row; all lines have the same draw."""
    draws = {tuple(draw_audit(lines, line, PLACES, "beacon", **options).places) for line in lines}
    assert len(draws) == 1
    n_missed = 0
    for beacon in range(N_AUDITS):
        drawn = {*draw_audit(lines, lines[-1], PLACES, f"beacon {beacon}", **options).places}
        n_missed += any(not false_of(i) & drawn for i in range(N_LINES))
    return n_missed


def same_rows(i):
    return set(PLACES[:N_FALSE])


@cache
def other_rows(i):
    return set(np.random.default_rng(i).choice(PLACES, N_FALSE, replace=False))


def test_a_draw_by_each_line_would_miss():
    """What is tested here is a danger: with one draw a line, most audits miss what is false in one of a hundred."""
    n, missed, n_audits = required_draw(N_PLACES, 0.05), 0, 15
    for beacon in range(n_audits):
        draws = [set(draw_trials(PLACES, n, seed=f"{line.hash}\n{beacon}")) for line in make_lines()]
        missed += any(not same_rows(0) & each for each in draws)
    assert missed > n_audits / 2


@pytest.mark.parametrize(
    "lines",
    [
        make_lines(),
        make_lines(suite_of=lambda i: f"renamed {i}"),
        make_lines(key_of=lambda i: f"key {i}"),
        make_lines(key_of=lambda i: f"key {i}", author_of=lambda i: f"somebody {i}"),
    ],
    ids=["copies", "names of the suite", "keys", "keys and names"],
)
def test_copies_of_the_same_rows_have_one_draw(lines):
    """Whatever an author signs again, renames, or signs with other keys, is drawn alike: there is one chance."""
    assert count_misses(lines, same_rows) <= MOST_MISSES


@pytest.mark.parametrize(
    ("lines", "options"),
    [
        (make_lines(), {}),
        (make_lines(key_of=lambda i: f"key {i}"), {}),
        (make_lines(key_of=lambda i: f"key {i}", author_of=lambda i: f"somebody {i}"), {"counts_all_keys": True}),
    ],
    ids=["one key", "one name", "all keys"],
)
def test_a_hundred_variants_that_are_false_elsewhere_are_found_together(lines, options):
    """One draw has a hundred variants to miss; it is larger, so that it misses none of them in 95 % of audits."""
    assert count_misses(lines, other_rows, **options) <= MOST_MISSES


def test_keys_and_names_that_are_taken_for_different_people_have_limits_of_their_own():
    """The remedy is a flag of who audits: the log cannot tell a hundred people from one with a hundred keys."""
    lines = make_lines(key_of=lambda i: f"key {i}", author_of=lambda i: f"somebody {i}")
    assert draw_audit(lines, lines[0], PLACES, "x").n_lines == 1
    assert count_misses(lines, other_rows) > N_AUDITS / 2


def test_limits_hold_for_all_lines_together():
    assert level_of_lines(1) == pytest.approx(0.95)
    assert level_of_lines(100) == pytest.approx(0.9995)
    one, many = (required_draw(N_PLACES, 0.05, level_of_lines(n)) for n in (1, 100))
    assert one < many < N_PLACES
    with pytest.raises(ShapeError, match="at least one line"):
        level_of_lines(0)


def test_a_limit_of_places_counts_all_of_their_rows():
    """Three rows a place, as of three entries, each of which may be false in the same cases."""
    n = required_draw(100, 0.05)
    assert max_false_rows_in_places([3] * (100 - n), n, 0, 0) <= 0.05 * 300
    assert max_false_rows_in_places([1] * 9 + [7], 90, 0, 0) == 7
    # Two false rows of one drawn place, and nothing undrawn: what is known is exact.
    assert max_false_rows_in_places([], 100, 1, 2) == 2
