import math
from dataclasses import replace

import numpy as np
import pytest
import synthetic

from gslcosim_bench.report.analysis import compute_causes
from gslcosim_bench.report.plans import build_plan_drawings
from gslcosim_bench.report.report_data import load_report_data

WALK = synthetic.Method(name="persistent_walk", success=0.25, mean_s=150.0)
SWEEP = synthetic.Method(name="sweep", success=0.6, mean_s=120.0)
PLAN = synthetic.Plan(
    methods=(WALK, SWEEP, synthetic.ORACLE), n_scenarios=1, n_families=1, repetitions=8, controls_frac=0.5,
    n_points=20, starts_m=synthetic.STARTS_M[::4],
)  # fmt: skip


@pytest.fixture(scope="module")
def material(tmp_path_factory):
    return load_report_data(synthetic.make_results(tmp_path_factory.mktemp("causes"), PLAN))


def causes(material):
    cells = np.unique(material.rows.cells)
    return cells, compute_causes(material, build_plan_drawings(material), cells)


def flown(material, cell, name):
    rows = material.rows
    entry = [entry.name for entry in material.entries].index(name)
    return (rows.cells == cell) & ~rows.is_control & (rows.entry == entry)


def test_geometry_is_how_rarely_the_persistent_walk_succeeds(material):
    for cell, of_case in zip(*causes(material), strict=True):
        assert of_case.geometry == pytest.approx(
            1.0 - material.rows["success"][flown(material, cell, WALK.name)].mean()
        )


def test_contact_is_how_rarely_the_sweep_meets_gas_in_a_third_of_the_time(material):
    rows = material.rows
    for cell, of_case in zip(*causes(material), strict=True):
        some = flown(material, cell, SWEEP.name)
        early = [t <= limit / 3.0 for t, limit in zip(rows["first_contact_s"][some], rows["time_limit_s"][some])]
        assert of_case.contact == pytest.approx(1.0 - np.mean(early))


def test_distance_is_the_shortest_way_over_the_diagonal(material):
    for cell, of_case in zip(*causes(material), strict=True):
        shortest_m = material.rows["shortest_path_m"][flown(material, cell, "oracle")][0]
        assert of_case.distance == pytest.approx(shortest_m / math.hypot(synthetic.ROOM_M, synthetic.ROOM_M), rel=1e-6)


def test_wind_that_never_turns_is_no_difficulty_and_wind_from_everywhere_is_all_of_it(material):
    assert [of_case.wind for of_case in causes(material)[1]] == pytest.approx([0.0] * 3, abs=1e-3)
    plan = material.maps[0]
    mixed = replace(material, maps=(replace(plan, wind_toward=np.zeros_like(plan.wind_toward)),))
    assert [of_case.wind for of_case in causes(mixed)[1]] == [1.0] * 3


def test_a_plume_that_fades_downwind_is_legible_and_one_that_grows_downwind_is_not(material):
    plan = material.maps[0]
    # A plume along x from the source, always there, that fades to its end.
    x = (np.arange(75) + 0.5) * plan.cell_m
    in_plume = (x[:, None] > synthetic.SOURCE_M[0]) & (np.abs(x[None, :] - synthetic.SOURCE_M[1]) < 0.3)
    fading = np.where(in_plume, 20.0 - x[:, None], 0.0)
    toward = np.zeros((75, 75, 2))
    toward[..., 0] = 1.0
    bare = replace(plan, occupied=np.zeros_like(plan.occupied), wind_toward=toward, intermittency=np.ones((75, 75)))

    def legibility(gas_ppm, **changes):
        mapped = replace(material, maps=(replace(bare, mean_gas_ppm=gas_ppm, **changes),))
        return causes(mapped)[1][0].legibility

    assert legibility(fading) > 0.9
    assert legibility(fading, wind_toward=-toward) < 0.1
    assert legibility(fading, intermittency=np.full((75, 75), 0.5)) == pytest.approx(0.5 * legibility(fading))
    assert math.isnan(legibility(np.zeros((75, 75))))


def test_what_was_not_run_or_drawn_is_not_reported(tmp_path):
    bare = synthetic.make_results(tmp_path, replace(PLAN, methods=(synthetic.WALKER,), maps=False, tracks=False))
    for of_case in causes(load_report_data(bare))[1]:
        assert all(math.isnan(value) for value in vars(of_case).values())
