"""Intervals for the error in a further set: coverage on made-up sets, pooling of kinds, and the stored table."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from gslcosim_validation.expected_errors import FILE, read_expected_errors
from gslcosim_validation.held_out_errors import (
    LEVEL,
    collect_set_errors,
    compute_expected_errors,
    hold_out,
    predict_log_ratio,
)
from gslcosim_validation.release_pairs import build_pairs, pair_series

RESULTS = Path(__file__).parents[4] / "docs" / "studies" / "reality"


def a_release(name, number, *log_ratios, kind_of_air="open_ground", quantity="mean"):
    """One release whose instruments measured 2 and were modelled with these errors."""
    modelled = 2.0 * np.exp(log_ratios)
    (pairs,) = build_pairs(kind_of_air, str(number), quantity, modelled, np.full(len(log_ratios), 2.0))
    return {**pairs, "measured_set": name}


def drawn(rng, *, n_sets, n, between, within, **more):
    """Sets whose means scatter by `between`, and releases in them by `within`."""
    return [
        a_release(f"set {i}", j, mean + within * rng.standard_normal(), **more)
        for i, mean in enumerate(between * rng.standard_normal(n_sets))
        for j in range(n)
    ]


def test_the_interval_is_students_where_each_set_has_one_release():
    """k single values: m -+ t(0.95, k - 1) s sqrt(1 + 1 / k), as every textbook has it."""
    middle, low, high = predict_log_ratio([np.array([x]) for x in (-0.3, 0.1, 0.4, 0.6)])
    s = np.std([-0.3, 0.1, 0.4, 0.6], ddof=1)
    assert middle == pytest.approx(0.2)
    assert high - middle == pytest.approx(middle - low)
    assert high - middle == pytest.approx(2.35336 * s * math.sqrt(1.25), rel=1e-5)


def test_sets_that_do_not_scatter_have_the_interval_of_their_releases():
    """One standard deviation within, none between: the many degrees of freedom within count, not the two between."""
    values = np.array([-1.0, -0.5, 0.5, 1.0] * 25)
    _, low, high = predict_log_ratio([values, values, values])
    assert high == pytest.approx(1.645 * values.std(ddof=1), rel=0.01)
    assert low == pytest.approx(-high)


@pytest.mark.parametrize(("between", "within"), [(0.5, 0.5), (0.0, 0.7), (0.8, 0.2)])
def test_a_known_spread_gives_the_nominal_coverage_on_sets_held_out(between, within):
    rng = np.random.default_rng(5)
    held = [each for _ in range(150) for each in hold_out(drawn(rng, n_sets=5, n=6, between=between, within=within))]
    coverage = sum(each.n_within for each in held) / sum(each.n for each in held)
    assert coverage == pytest.approx(LEVEL, abs=0.04)


def test_a_set_from_ten_times_the_spread_is_found_outside():
    rng = np.random.default_rng(6)
    calm = drawn(rng, n_sets=6, n=8, between=0.2, within=0.2)
    wild = [a_release("wild", i, 10.0 * 0.28 * rng.standard_normal()) for i in range(40)]
    held = {each.name: each for each in hold_out([*calm, *wild])}
    assert held["wild"].n_within < 0.4 * held["wild"].n
    assert sum(held[f"set {i}"].n_within for i in range(6)) == 48


def test_a_bias_of_its_own_is_found_outside():
    sets = [a_release(f"set {i}", j, 0.1 * i - 0.1 * j) for i in range(4) for j in range(3)]
    held = {
        each.name: each.n_within for each in hold_out([*sets, a_release("dense", 1, 4.0), a_release("dense", 2, 4.1)])
    }
    assert held["dense"] == 0


def test_an_error_is_that_of_the_geometric_mean_of_a_release():
    pairs = [a_release("yard", 1, math.log(0.5), math.log(8.0)), a_release("yard", 2, 0.0, 0.0, 0.0)]
    (yard,) = collect_set_errors(pairs, "mean")
    assert np.exp(yard.log_ratios) == pytest.approx([2.0, 1.0], rel=1e-4)
    assert yard.fac2 == pytest.approx(4 / 5)


def test_a_kind_with_too_few_sets_has_the_interval_of_all_kinds():
    open_ground = drawn(np.random.default_rng(7), n_sets=3, n=4, between=0.3, within=0.3)
    room = [a_release("office", j, 2.0 + 0.1 * j, kind_of_air="room_with_heat") for j in range(3)]
    errors = compute_expected_errors([*open_ground, *room])
    own, pooled = errors["open_ground"]["mean"], errors["room_with_heat"]["mean"]
    assert own["sets"] == {"set 0": 4, "set 1": 4, "set 2": 4}
    assert not own["of_all_kinds"]
    assert pooled["of_all_kinds"]
    assert pooled["sets"] == {**own["sets"], "office": 3}
    assert errors["room_with_forced_wind"]["mean"] == pooled
    assert "intensity" not in errors["open_ground"]


def test_one_set_alone_predicts_nothing():
    pairs = [a_release("yard", j, 0.1 * j) for j in range(5)]
    assert list(hold_out(pairs)) == []
    assert compute_expected_errors(pairs) == {}


def test_series_are_paired_by_release_above_the_floor():
    t = np.arange(24.0)
    modelled = np.stack([1.0 + (-1.0) ** t, np.full(24, 0.01), np.full(24, 4.0)], axis=1)
    measured = np.stack([2.0 + (-1.0) ** t, np.full(24, 0.02), np.full(24, 0.05)], axis=1)
    measured[20:, 0] = np.nan
    release = np.repeat(["a", "b"], [20, 4])
    mean, intensity = pair_series("open_ground", modelled, measured, release, floor=0.1)
    assert (mean["release"], mean["modelled"], mean["measured"]) == ("a", [1.0, 4.0], [2.0, 0.1])
    assert (intensity["quantity"], intensity["modelled"], intensity["measured"]) == ("intensity", [1.0], [0.5])


def test_the_table_of_the_package_is_that_of_the_stored_results():
    pairs = [each for path in sorted(RESULTS.glob("*.json")) for each in json.loads(path.read_text()).get("pairs", ())]
    stored = json.loads((RESULTS / FILE).read_text())
    assert read_expected_errors() == stored
    assert stored["level"] == LEVEL
    assert json.loads(json.dumps(compute_expected_errors(pairs))) == stored["kinds_of_air"]
