from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import synthetic

from gslcosim.bench.report.analysis import analyse
from gslcosim.bench.report.curves import QUANTUM_M, select_tracks
from gslcosim.bench.report.report_data import load_report_data

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
    assert row("oracle").rank == 1
    assert row("good").rank == row("twin").rank == 2
    assert row("poor").rank == 4


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


def test_plumes_are_drawn_whole_only_where_there_are_enough(tmp_path):
    material = load_report_data(synthetic.make_results(tmp_path, replace(PLAN, tracks=False)))
    assert not analyse(material).draws_plumes
    columns = dict(material.rows.columns) | {"gas_seed": material.rows["repetition"]}
    rows = replace(material.rows, columns=columns)
    assert analyse(replace(material, rows=rows)).draws_plumes


def test_tracks_are_thinned_and_keep_their_ends(analysis):
    analysed, _, _ = analysis
    material, rooms = analysed.material, analysed.rooms
    for track in select_tracks(material, rooms)[:20]:
        places_m = np.cumsum(track.steps, axis=0) * QUANTUM_M
        start_m = [material.rows[key][track.row] for key in ("start_x_m", "start_y_m")]
        assert places_m[0] == pytest.approx(start_m, abs=QUANTUM_M)


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
