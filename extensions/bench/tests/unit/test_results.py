"""Results in Python: what two entries are compared by."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from gslcosim_bench.results import Results, compare
from gslcosim_bench.statistics.rates import rate_over_units
from gslcosim_bench.statistics.sampling_units import find_sampling_units
from gslcosim_bench.store import TRIALS


def make_results(success):
    """Return results of entries by the successes of their cases, each case in a room of its own."""
    rows = [
        {
            "entry": entry, "case": f"case_{i}", "environment_hash": f"{i:064x}", "gas_seed": k, "repetition": k,
            "is_control": False, "success": bool(won), "time_s": 10.0 if won else 300.0, "time_limit_s": 300.0,
        }
        for entry, cases in success.items()
        for i, runs in enumerate(cases)
        for k, won in enumerate(runs)
    ]  # fmt: skip
    empty = dict.fromkeys(TRIALS.names)
    return Results(Path("nowhere"), pa.Table.from_pylist([empty | row for row in rows], schema=TRIALS))


def test_cases_count_the_same_in_rates_and_differences():
    """Ten runs of the first case, two of each other: a finds the first alone, b all others."""
    a = [[1] * 10, *[[0, 0]] * 6]
    b = [[0] * 10, *[[1, 1]] * 6]
    results = make_results({"a": a, "b": b})
    assert results.success("a").value == pytest.approx(1 / 7)
    assert results.mean_time_s("a").value == pytest.approx((10 + 6 * 300) / 7)
    found = compare(results, "a", "b")
    assert found.success.value == pytest.approx(results.success("a").value - results.success("b").value)
    assert found.time_s.value == pytest.approx(5 / 7 * 290)


def test_shares_end_at_one():
    """Quicker in all rooms but one: Student's interval reached to 1.03."""
    results = make_results({"a": [[1, 1]] * 8, "b": [[1, 1], *[[0, 0]] * 7]})
    found = compare(results, "a", "b")
    assert (found.better.high, found.success.high) == (1.0, 1.0)


def test_a_rate_of_all_runs_is_no_surer_than_rooms_make_it():
    """Twelve rooms of five runs; as 60 independent runs its interval began at 92 %."""
    room = np.repeat(np.arange(12), 5)
    units = find_sampling_units(room, room, room)
    alone = rate_over_units(np.ones(60), units)
    assert (alone.value, alone.high) == (1.0, 1.0)
    assert alone.low == pytest.approx(
        rate_over_units(np.ones(12), find_sampling_units(*[np.zeros(12)] * 3)).low, abs=0.06
    )
    assert alone.low < 0.75
    alike = make_results({"a": [[1] * 5] * 12, "b": [[1] * 5] * 6 + [[0] * 5] * 6})
    mixed = make_results({"a": [[1] * 5] * 12, "b": [[1, 0, 1, 0, 1]] * 6 + [[0, 1, 0, 1, 0]] * 6})
    assert alone.low == pytest.approx(alike.success("a").low)
    assert mixed.success("a").low > 0.9
