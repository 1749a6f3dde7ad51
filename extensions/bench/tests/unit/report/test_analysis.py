import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic

from gslcosim_bench.report.analysis import analyse, find_beaten
from gslcosim_bench.report.conclusions import describe_conclusions
from gslcosim_bench.report.report_data import load_report_data
from gslcosim_bench.report.tables import build_leaderboard_json

GOOD = synthetic.Method(name="good", success=0.8, mean_s=60.0, luck=0.1, declares=1.0, has_belief=True)
TWIN = replace(GOOD, name="twin")
POOR = synthetic.Method(name="poor", success=0.3, mean_s=150.0, luck=0.3)
PLAN = synthetic.Plan(
    methods=(POOR, GOOD, TWIN, synthetic.ORACLE), n_scenarios=2, repetitions=12, controls_frac=1.0, harder=0.0,
    n_points=12, starts_m=synthetic.STARTS_M[::3], seed=11,
)  # fmt: skip


@pytest.fixture(scope="module")
def analysis(tmp_path_factory):
    analysed = analyse(load_report_data(synthetic.make_results(tmp_path_factory.mktemp("told"), PLAN)))
    names = [entry.name for entry in analysed.material.entries]

    @cache
    def row(name, view=0):
        return next(row for row in analysed.views[view].standings if names[row.entry] == name)

    return analysed, names, row


def test_intervals_hold_what_is_true(analysis):
    _, _, row = analysis
    for method in PLAN.methods:
        success, lift = row(method.name).success, row(method.name).lift
        assert success.low <= method.success <= success.high
        assert lift.low <= method.success - method.luck <= lift.high
        assert success.n == lift.n == 72


def test_twins_share_a_rank_and_the_poor_one_comes_after(analysis):
    _, _, row = analysis
    assert [(row(name).rank, row(name).last_rank) for name in ("oracle", "good", "twin", "poor")] == [
        (1, 1), (2, 3), (2, 3), (4, 4)
    ]  # fmt: skip


def test_ranks_follow_from_the_verdicts_of_pairs(analysis):
    analysed, _, _ = analysis
    for view in analysed.views:
        for standing in view.standings:
            beaten_by = sum(standing.entry in find_beaten(view, other.entry) for other in view.standings)
            places = (1 + beaten_by, len(view.standings) - len(find_beaten(view, standing.entry)))
            assert (standing.rank, standing.last_rank) == places
        for pair in view.pairs:
            assert (pair.verdict != 0) == (pair.p <= 0.05) == (not pair.score.holds_zero)


def test_pairs_show_who_is_better(analysis):
    analysed, names, _ = analysis
    verdicts = {(names[p.a], names[p.b]): p.verdict for p in analysed.everything.pairs}
    verdicts |= {(b, a): -verdict for (a, b), verdict in verdicts.items()}
    assert (verdicts["good", "twin"], verdicts["good", "poor"], verdicts["poor", "oracle"]) == (0, 1, -1)
    assert all(p.score.n == 72 for p in analysed.everything.pairs)


def test_views_are_parts_of_the_whole(analysis):
    analysed, _, _ = analysis
    assert [view.key for view in analysed.views] == ["all", "family:family_1", "family:family_2"]
    assert (
        sum(view.n_trials for view in analysed.views[1:]) == analysed.everything.n_trials == len(analysed.material.rows)
    )


def test_normalised_score_needs_both_anchors(analysis):
    _, _, row = analysis
    assert np.isnan(row("good").normalised.value)


def test_declarations_count_each_run_once(analysis):
    analysed, names, _ = analysis
    declared = {names[d.entry]: d for d in analysed.everything.declarations}
    assert set(declared) == {"good", "twin"}
    good = declared["good"]
    assert good.right + good.elsewhere + good.silent == good.alarms + good.quiet == 72
    assert good.curve.area.value > good.place_curve.area.value > 0.0
    assert good.curve.area.value > 0.5


def test_curves_end_at_the_rate_of_success_and_profiles_below_it(analysis):
    analysed, _, _ = analysis
    rates = {row.entry: row.success.value for row in analysed.everything.standings}
    for line in analysed.everything.curves:
        assert line.value[-1] == pytest.approx(rates[line.entry])
        assert np.all(np.diff(line.value) >= 0)
    for line in analysed.everything.profiles:
        assert line.value[-1] <= rates[line.entry] + 1e-12


def test_nearer_radii_are_reached_later_and_less_often(analysis):
    analysed, _, _ = analysis
    runtimes = analysed.everything.runtimes
    for wide, narrow in (("5", "2"), ("2", "1"), ("1", "05")):
        for a, b in zip(runtimes[wide], runtimes[narrow], strict=True):
            assert np.all(a.value >= b.value - 1e-12)


def test_beliefs_are_reported_of_those_that_have_one_and_grow_better(analysis):
    analysed, names, _ = analysis
    mass = analysed.everything.beliefs["mass"]
    assert {names[line.entry] for line in mass} == {"good", "twin"}
    assert all(line.value[0] < 0.05 and line.value[-1] > 0.5 for line in mass)
    last = {names[b.entry]: b for b in analysed.everything.last_beliefs}
    assert last["good"].mass_near.value == pytest.approx(mass[0].value[-1], abs=1e-3)


def test_grades_are_easier_where_more_succeed(analysis):
    analysed, _, _ = analysis
    ordered = sorted(analysed.grades, key=lambda grade: grade.success.value)
    difficulties = [grade.difficulty.value for grade in ordered]
    assert difficulties == sorted(difficulties, reverse=True)
    assert {grade.grade for grade in analysed.grades} <= {"easy", "medium", "hard"}


def test_rooms_are_drawn_where_there_are_enough_else_plumes_else_flights(tmp_path):
    material = load_report_data(synthetic.make_results(tmp_path, replace(PLAN, tracks=False)))
    rows = material.rows

    def drawn(**columns):
        changed = replace(rows, columns=dict(rows.columns) | columns)
        view = analyse(replace(material, rows=changed)).everything
        return view.units.level, view.units.n_rooms, view.units.n_plumes

    assert drawn() == ("flights", 2, 6)
    assert drawn(gas_seed=rows["repetition"]) == ("plumes", 2, 24)
    assert drawn(environment_hash=rows["case"]) == ("rooms", 6, 18)


def test_conclusions_say_who_is_best_for_which_rooms_and_what_is_open(analysis):
    analysed, _, _ = analysis
    said = describe_conclusions(analysed, analysed.everything)
    assert said.holds[0] == (
        "2 entries are beaten by no other method: twin and good; any of them may be the best. The anchor oracle, which "
        "knows the source, beats 2 of them (twin and good)."
    )
    assert said.holds[1].startswith("Of 6 pairs of entries, 5 are told apart by score, ")
    assert "all true together in 95 of 100" in said.holds[2]
    assert said.holds[2].endswith("It draws single flights within cases.")
    assert said.limits[0].startswith("The conclusions hold for these 2 rooms and these 6 plumes, for other noise")
    assert any("needs no declaration" in text for text in said.limits)


def test_conclusions_of_single_flights_claim_nothing(tmp_path):
    one = replace(PLAN, n_scenarios=1, starts_m=((3, 3),), repetitions=1, controls_frac=0.0, tracks=False)
    analysed = analyse(load_report_data(synthetic.make_results(tmp_path, one)))
    said = describe_conclusions(analysed, analysed.everything)
    assert said.holds[0].endswith("any of them may be the best.")
    assert said.holds[1].startswith("Of 6 pairs of entries, 0 are told apart")
    assert said.holds[2].endswith("It draws single flights of all cases together.")
    assert "Open pairs are not shown to be equal, even where both have one rank. More cases would tell." in said.limits


def test_conclusions_name_what_is_drawn_where_each_case_has_one_flight(tmp_path):
    plan = replace(PLAN, methods=PLAN.methods[:2], n_scenarios=1, repetitions=1, controls_frac=0.0, tracks=False)
    material = load_report_data(synthetic.make_results(tmp_path, plan))
    rows = material.rows
    one_plume = replace(rows, columns=dict(rows.columns) | {"gas_seed": np.zeros(len(rows), dtype=np.int64)})
    analysed = analyse(replace(material, rows=one_plume))
    said = describe_conclusions(analysed, analysed.everything)
    assert said.holds[1].startswith("The one pair of entries is ")
    assert said.holds[2].endswith("It draws single flights within plumes.")
    assert "for other flights like these in the same gas" in said.limits[0]
    assert ": their intervals reach some " in said.limits[1]


def test_entries_without_reported_pairs_have_no_verdicts_in_the_leaderboard(analysis):
    analysed, _, _ = analysis
    first, second, *_ = analysed.views
    shown = json.loads(build_leaderboard_json(replace(analysed, views=(first, replace(second, pairs=())))))
    whole, part = (view["rows"] for view in shown["views"])
    assert whole[-1]["beats"] == []
    assert [(row["beats"], row["same_as"]) for row in part] == [(None, None)] * 4


def test_radii_of_declarations_are_shown_where_declaring_matters(analysis):
    analysed, _, _ = analysis
    rows = analysed.material.rows

    def shown(**columns):
        changed = replace(rows, columns=dict(rows.columns) | columns)
        return replace(analysed, material=replace(analysed.material, rows=changed)).is_about_declarations

    some = rows["repetition"] == 0
    assert shown()
    assert not shown(declared=rows["declared"] & some)
    assert shown(declared=rows["declared"] & some, success_of=np.full(len(rows), "declaration"))


def test_entries_are_the_same_where_no_difference_that_matters_is_left(tmp_path):
    folder = synthetic.make_results(tmp_path, replace(PLAN, tracks=False, maps=False))
    material = load_report_data(folder)
    assert material.smallest_difference == 0.1
    same = {}
    for points in (10, 30):
        stated = replace(material, manifest=dict(material.manifest) | {"smallest_difference_points": points})
        view = analyse(stated).everything
        same[points] = [(stated.entries[p.a].name, stated.entries[p.b].name) for p in view.pairs if p.is_same]
        assert all(max(-p.success.low, p.success.high) < points / 100 for p in view.pairs if p.is_same)
    assert same == {10: [], 30: [("good", "twin")]}


def test_errors_of_declarations_rise_to_the_share_that_declared_and_hold_the_rates_of_the_table(analysis):
    analysed, names, row = analysis
    assert {names[line.entry] for line in analysed.everything.errors} == {"good", "twin"}
    for line in analysed.everything.errors:
        assert np.all(np.diff(line.value) >= 0.0)
        for radius_m, figure in ((0.5, "declared_05"), (1.0, "declared_1"), (2.0, "declared_2")):
            shown = getattr(row(names[line.entry]), figure)
            at = np.searchsorted(line.x, radius_m - 1e-9)
            assert (line.value[at], line.low[at]) == pytest.approx((shown.value, shown.low))
    assert row("poor").declared_2.value == 0.0


def test_rooms_of_a_scenario_with_several_layouts_have_a_plan_each(tmp_path):
    folder = synthetic.make_results(tmp_path, replace(PLAN, n_scenarios=1, n_families=1, tracks=False))
    material = load_report_data(folder)
    whole = material.maps[0]
    starts = list(dict.fromkeys(material.rows["varied"].tolist()))
    maps = tuple(replace(whole, varied=varied) for varied in starts)
    rooms = analyse(replace(material, maps=maps)).rooms
    assert [room.label for room in rooms] == ["room_1 1", "room_1 2", "room_1 3"]
    assert sum(len(room.rows) for room in rooms) == len(material.rows)
    for room, varied in zip(rooms, starts, strict=True):
        assert set(material.rows["varied"][room.rows]) == {varied}
