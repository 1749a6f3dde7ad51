"""The tables of the open comparison's study, from results that were never flown."""

import importlib.util
import itertools
import json
import math
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import synthetic

from gslcosim.base.errors import ShapeError
from gslcosim_bench.report.number_formats import format_points

SCRIPT = Path(__file__).parents[5] / "docs" / "studies" / "open_2026.py"
GOOD = synthetic.Method(name="good", success=0.8, declares=1.0)
POOR = synthetic.Method(name="poor", success=0.2, declares=0.5)
SWEEP = synthetic.Method(name="sweep", success=0.9, mean_s=40.0)


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("open_2026", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_tables_have_each_entry_scenario_and_stratum(study, tmp_path, capsys, monkeypatch):
    plan = synthetic.Plan(
        methods=(SWEEP, POOR, GOOD, synthetic.ORACLE), n_scenarios=2, starts_m=synthetic.STARTS_M[-2:], maps=False,
        tracks=False, repetitions=6, harder=0.0,
    )  # fmt: skip
    folder = synthetic.make_results(tmp_path / "results", plan)
    monkeypatch.setattr(sys, "argv", ["open_2026.py", str(folder)])
    study.main()
    entries, scenarios, groups, strata = capsys.readouterr().out.strip().split("\n\n")
    assert set(re.findall(r"^\| `(\w+)` \| 24 \|", entries, re.MULTILINE)) == {"sweep", "poor", "good", "oracle"}
    assert entries.index("`good`") < entries.index("`poor`")
    for scenario in ("room_1", "room_2"):
        (line,) = re.findall(rf"^\| `{scenario}` \|.*$", scenarios, re.MULTILINE)
        assert "(`sweep`)" in line
        assert "(`good`)" in line
    assert "oracle" not in scenarios
    assert re.search(r"^\| all \| 2 \| `good` \d.* \| `sweep` ", groups, re.MULTILINE)
    assert re.search(r"^\| family `\w+` \|", groups, re.MULTILINE)
    assert re.search(r"^\| stratum ", groups, re.MULTILINE)
    assert re.search(r"\| (below 1|1 to 2|2 to 4|4 and more) \| \d \| \d+ \| \d", strata)


def test_two_seeds_are_ranked_together_and_compared(study, tmp_path, capsys, monkeypatch):
    folders = []
    for seed in (1, 2):
        plan = synthetic.Plan(
            methods=(SWEEP, POOR, GOOD, synthetic.ORACLE), n_scenarios=2, starts_m=synthetic.STARTS_M[-2:], maps=False,
            tracks=False, repetitions=6, harder=0.0, seed=seed,
        )  # fmt: skip
        folders.append(str(synthetic.make_results(tmp_path / f"results_{seed}", plan)))
    monkeypatch.setattr(sys, "argv", ["open_2026.py", *folders])
    study.main()
    ranks, seeds, agreement, places, *_ = capsys.readouterr().out.strip().split("\n\n")
    assert re.search(r"\| `oracle` \| 48 \|", ranks)
    assert ranks.index("`good` | 48 |") < ranks.index("`poor` | 48 |")
    assert set(re.findall(r"^\| `(\w+)` \| \d+ of 24 \| \d+ of 24 \|", seeds, re.MULTILINE)) == {
        "sweep",
        "poor",
        "good",
    }
    assert re.search(r"of 3 pairs change their order", agreement)
    assert places.index("`good`") < places.index("`poor`")


def test_the_whole_suite_is_compared_with_quick_profiles(study, tmp_path, capsys, monkeypatch):
    folders = []
    for seed, repetitions in ((1, 6), (2, 6), (3, 12)):
        plan = synthetic.Plan(
            methods=(SWEEP, POOR, GOOD, synthetic.ORACLE), n_scenarios=2, starts_m=synthetic.STARTS_M[-2:], maps=False,
            tracks=False, repetitions=repetitions, harder=0.0, seed=seed,
        )  # fmt: skip
        folders.append(str(synthetic.make_results(tmp_path / f"results_{seed}", plan)))
    monkeypatch.setattr(sys, "argv", ["open_2026.py", *folders[:2], "--whole", folders[2]])
    study.main()
    rates, of_others, of_same, alarms, first, ranks, *_ = capsys.readouterr().out.strip().split("\n\n")
    assert re.search(r"\| `good` \| [5-9]\d \(.*\) \| \d+ \(.*\) \| [6-9]\d \(", rates)
    assert rates.index("`sweep`") < rates.index("`good`") < rates.index("`poor`")
    assert "of other seeds: Kendall's tau" in of_others
    assert "the same seed: Kendall's tau" in of_same
    told = re.search(r"of (\d) pairs that the whole suite tells apart it tells (\d), and (\d)", of_others)
    assert told, of_others
    assert int(told[1]) >= int(told[2]) >= 1
    assert told[3] == "0"
    assert re.search(r"\| `poor` \| 20 \| ", alarms)
    assert "`oracle` | 2 | 100 " in first
    assert "| `good` | 48 |" in ranks


def test_entries_with_missing_flights_are_left_out_of_the_whole(study, tmp_path):
    plan = synthetic.Plan(
        methods=(GOOD, POOR), n_scenarios=1, starts_m=synthetic.STARTS_M[-1:], maps=False, tracks=False,
        controls_frac=0.0, missing=1,
    )  # fmt: skip
    data = study.load_report_data(synthetic.make_results(tmp_path / "results", plan))
    assert [entry.name for entry in study.select_complete(data).entries] == ["good"]


def test_flights_of_a_scenario_in_two_rooms_are_no_pair(study, tmp_path):
    plan = synthetic.Plan(
        methods=(GOOD, POOR), n_scenarios=1, starts_m=synthetic.STARTS_M[-2:], maps=False, tracks=False
    )
    data = study.load_report_data(synthetic.make_results(tmp_path / "results", plan))
    assert len(set(data.rows["case"].tolist())) == 2
    assert len(set(study.pool_results([data]).rows.unit.tolist())) == len(data.rows) / 2
    assert len(study.select_quick(data).rows) == 2


def test_cases_in_which_one_entry_did_not_take_off_are_left_out_for_all(study, tmp_path, capsys):
    plan = synthetic.Plan(methods=(GOOD, POOR), n_scenarios=1, maps=False, tracks=False)
    data = study.load_report_data(synthetic.make_results(tmp_path / "results", plan))
    text = "commands: The vehicle refused 9 of 9 commands, the first because take_off: expected a free way to a height"
    warnings = np.array([f"{text}; the vehicle stays." if i == 3 else "" for i in range(len(data.rows))])
    rows = type(data.rows).of_columns({**data.rows.columns, "warnings": warnings}, ["good", "poor"])
    kept = study.leave_out_grounded(replace(data, rows=rows))
    assert len(kept.rows) == len(rows) - 2
    assert "1 case left out" in capsys.readouterr().err


def test_effects_of_axes_in_mixtures_are_told_apart(study, tmp_path, capsys):
    plan = synthetic.Plan(
        methods=(GOOD,), n_scenarios=1, starts_m=synthetic.STARTS_M[-1:], maps=False, tracks=False, controls_frac=0.0,
        repetitions=16,
    )  # fmt: skip
    data = study.load_report_data(synthetic.make_results(tmp_path / "results", plan))
    levels = list(itertools.product(("boxes", "walls"), ("pid", "mox"), ("steady", "gusting"), (1, 2)))
    labels = [{"labels.room": a, "labels.sensor": b, "labels.wind": c, "seed": d} for a, b, c, d in levels]
    columns = {
        **data.rows.columns,
        "family": np.full(16, "mixed"),
        "varied": np.array([json.dumps(each) for each in labels]),
        # Walls halve it, and a MOX takes a quarter.
        "success": np.array([1.0 - 0.5 * (a == "walls") - 0.25 * (b == "mox") for a, b, _, _ in levels]),
    }
    rows = type(data.rows).of_columns(columns, ["good"])
    study.print_mixture_effects(replace(data, rows=rows))
    printed = capsys.readouterr().out
    for axis, change, effect in (("room", "walls in place of boxes", -50), ("sensor", "mox in place of pid", -25)):
        assert f"| `{axis}` | {change} | {format_points(effect / 100)} (" in printed
    assert re.search(r"`wind` \| gusting in place of steady \| [^0-9]?0 \(", printed)


def test_the_page_has_the_figures_of_the_published_flights(monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(SCRIPT.parent))
    importlib.import_module("open_2026_data").main()
    printed, page = capsys.readouterr().out, SCRIPT.with_suffix(".md").read_text(encoding="utf-8")
    tuned = re.findall(r"^\| (infotaxis|source_map|surge_cast)(, \w+)? (\|.*)$", printed, re.MULTILINE)
    assert len(tuned) == 12
    for name, kind, figures in tuned:
        assert f"| `{name}`{kind} {figures}" in page
    found = re.search(r"(\d+) declarations, .* within 2 m; (\d+) wrong, (\d+) of these", printed)
    assert f"{found[2]} of their {found[1]} declarations are wrong, {found[3]} of these by less than 2 m" in page
    silent = re.search(r"(\d+ of \d+) runs of infotaxis and particle_filter", printed)
    assert f"{silent[1]} runs of `infotaxis` and `particle_filter`" in page
    places = re.findall(r"^\| (?:all|open ground|room|mixed) \| \d+ \| .*$", printed, re.MULTILINE)
    assert len(places) == 4
    assert all(line in page for line in places)
    far = re.search(r"(\d+) 2 m and more away, (\d+) of these among walls; (\d+) runs met no gas", printed)
    assert f"{far[3]} of the 290 runs met no gas, and {far[1]} declarations were 2 m and more away, {far[2]} " in page


def test_coverage_is_the_limit_over_the_sweeps_median_time(study):
    assert study.coverage_ratio(np.array([50.0, 100.0, 400.0]), 300.0) == pytest.approx(3.0)
    assert study.coverage_ratio(np.array([50.0, math.nan, math.inf]), 300.0) == 0.0
    assert math.isnan(study.coverage_ratio(np.array([]), 300.0))
    assert [study.coverage_stratum(ratio) for ratio in (0.0, 1.0, 1.9, 2.0, 3.9, 4.0, 50.0)] == [
        study.STRATA[i] for i in (0, 1, 1, 2, 2, 3, 3)
    ]
    assert study.coverage_stratum(math.nan) == ""


def simulated_strata(seed, slopes, *, n_cells=12, n_entries=24, n=6):
    rng = np.random.default_rng(seed)
    ability = rng.normal(size=n_entries)
    ability = (ability - ability.mean()) / ability.std()
    difficulty = rng.normal(size=n_cells * len(slopes))
    slope = np.repeat(slopes, n_cells)[:, None]
    p = 1.0 / (1.0 + np.exp(-slope * (ability[None, :] - difficulty[:, None])))
    trials = np.full(p.shape, n)
    return rng.binomial(trials, p), trials, np.repeat([f"stratum {a:g}" for a in slopes], n_cells).tolist()


def test_discrimination_holds_the_slopes_that_are_true(study):
    slopes = (0.4, 1.0, 2.5)
    found, n_held = [], 0
    for seed in range(8):
        fits = study.fit_discrimination(*simulated_strata(seed, slopes))
        assert [fit.stratum for fit in fits] == ["stratum 0.4", "stratum 1", "stratum 2.5"]
        assert [(fit.n_cells, fit.slope.n) for fit in fits] == [(12, 12 * 24 * 6)] * 3
        assert fits[0].slope.high < fits[1].slope.low < fits[1].slope.high < fits[2].slope.low
        n_held += sum(fit.slope.low <= a <= fit.slope.high for fit, a in zip(fits, slopes, strict=True))
        found.append([fit.slope.value for fit in fits])
    assert np.mean(found, axis=0) == pytest.approx(slopes, rel=0.15)
    assert n_held >= 18, "of 24 intervals, of which 22 are expected to hold the truth"


def test_a_stratum_of_coin_flips_tells_entries_apart_by_little(study):
    fits = study.fit_discrimination(*simulated_strata(3, (0.0, 2.0)))
    assert fits[0].slope.value < 0.4
    assert fits[0].slope.high < fits[1].slope.low
    assert fits[1].slope.low > 1.0
    with pytest.raises(ShapeError, match="a stratum for each cell"):
        study.fit_discrimination(np.ones((2, 2)), np.ones((2, 2)), ["a"])
