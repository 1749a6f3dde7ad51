"""Plumes of gas models in an open field, as records that can be scored, and their case on the page."""

import dataclasses
import json

import numpy as np
import pytest

from gslcosim_validation import read_measured
from gslcosim_validation.cases import load_case
from gslcosim_validation.cases.gas_models import farthest_distance, why_not_judged
from gslcosim_validation.gas_models import (
    DISTANCES_M,
    GAS_SETTINGS,
    SHEARS_PER_S,
    SOURCE_SIGMA_M,
    TIME_SCALE_S,
    VELOCITY_STD_M_S,
    disperse_pairs,
    mean_on_axis,
    measure_sheared_eddies,
    record_plume,
    score_plume,
)
from gslcosim_validation.plume_statistics import score_absolute_dispersion, taylor_variance_m2
from gslcosim_validation.results import plain_estimate


@pytest.mark.slow
@pytest.mark.parametrize("name", GAS_SETTINGS)
def test_each_setting_gives_a_record_that_follows_from_its_seed(name):
    first, second, other = (record_plume(GAS_SETTINGS[name], seconds=2.0, seed=seed) for seed in (1, 1, 2))
    assert first.shape == (20, len(DISTANCES_M))
    assert (first >= 0).all()
    assert first.any()
    np.testing.assert_array_equal(first, second)
    assert (first != other).any()


def test_the_farthest_distance_leaves_out_what_no_law_is_for():
    record = np.random.default_rng(1).gamma(1.0, 1.0, (4000, 4))
    scores = [
        dataclasses.replace(each, intensity=plain_estimate(intensity), skewness_ratio=plain_estimate(ratio))
        for each, intensity, ratio in zip(
            score_plume(record, n_draws=2), (1.0, 1.0, 0.3, 2.0), (1.1, 0.6, 0.1, np.nan), strict=True
        )
    ]
    assert farthest_distance("skewness_ratio", scores) == (1, 1, 2)
    assert farthest_distance("skewness_ratio", scores[2:]) == (None, 0, 0)


def test_blanks_are_judged_where_a_plume_has_pauses():
    (scores,) = score_plume(np.random.default_rng(1).gamma(1.0, 1.0, (4000, 1)), n_draws=2)
    scores = dataclasses.replace(scores, blank_exponent=plain_estimate(1.5))
    for intensity, reason in ((0.9, "no_pauses"), (1.0, "")):
        assert (
            why_not_judged("blank_exponent", dataclasses.replace(scores, intensity=plain_estimate(intensity))) == reason
        )
    nowhere = dataclasses.replace(scores, blank_exponent=plain_estimate(np.nan), intensity=plain_estimate(0.5))
    assert why_not_judged("blank_exponent", nowhere) == "undefined"
    assert why_not_judged("conditional_intensity", nowhere) == ""


def test_the_mean_on_the_axis_is_that_of_a_slender_gaussian_plume():
    """sqrt(2 pi) / (U S^2) while gas spreads more slowly along the wind than the wind blows."""
    for distance_m in (1.0, 30.0, 1000.0):
        spread_m2 = taylor_variance_m2(
            np.array([distance_m]), velocity_std_m_s=VELOCITY_STD_M_S, time_scale_s=TIME_SCALE_S
        )
        slender = np.sqrt(2.0 * np.pi) / (SOURCE_SIGMA_M**2 + spread_m2[0])
        assert mean_on_axis(distance_m) == pytest.approx(slender, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("shear_per_s", SHEARS_PER_S)
def test_eddies_in_shear_keep_their_strength(shear_per_s):
    ratios = [measure_sheared_eddies(shear_per_s, seed=seed) for seed in range(1, 9)]
    assert np.mean(ratios) == pytest.approx(1.0, rel=0.15)
    assert ratios[0] != 1.0


@pytest.mark.slow
def test_tracers_without_turbulence_forget_at_once():
    """Twice the diffusivity times the time, whatever the law of turbulent air is."""
    found = disperse_pairs(GAS_SETTINGS["filament"], n_histories=2)
    assert (found.across_m**2).mean(axis=0)[-1] == pytest.approx(2 * 0.002 * found.time_s[-1], rel=0.2)
    (ratio,) = score_absolute_dispersion(
        found.across_m[:, -1:],
        found.time_s[-1:],
        velocity_std_m_s=VELOCITY_STD_M_S,
        time_scale_s=TIME_SCALE_S,
        histories=np.repeat(found.histories, 2),
    )
    assert ratio.n == 2
    assert ratio.low <= ratio.value <= ratio.high < 0.05


@pytest.mark.slow
def test_the_case_has_a_row_for_each_figure_distance_and_law(tmp_path):
    entry = {"id": "richardson_constant", "values": {"g": 0.5}}
    (tmp_path / "published.json").write_text(json.dumps({"entries": [entry]}))
    result = load_case("gas-models").run(read_measured(tmp_path), "quick")
    rows = {row.quantity: row for row in result.rows}
    at_distances = [
        name for name in rows if name.startswith("filament, turbulence: ") and " m" in name.partition(";")[0][-4:]
    ]
    assert len(at_distances) == 5 * len(DISTANCES_M)
    # Of both models with eddies, the mean on the axis, shear, two laws of dispersion, two full rooms, and walls.
    assert len(rows) == 25 + 5 + 1 + len(SHEARS_PER_S) + 2 + 2 + 1
    assert all(row.if_missed for row in result.rows)
    # Models without eddies are anchors, never judged.
    assert not any(name.startswith(("filament:", "farrell:", "meandering_plume")) for name in rows)
    assert all((row.goal is None) == ("no goal, " in name) for name, row in rows.items())

    def row_of(text):
        (row,) = [row for row in result.rows if text in row.quantity]
        return row

    assert "`filament`" in row_of("turbulence: conditional intensity, 8 m").anchor
    assert row_of("filament, turbulence: variance of tracers").ours.value == pytest.approx(1.0, abs=0.5)
    assert "`filament` 0.0" in row_of("filament, turbulence: variance of tracers").anchor
    assert row_of("filament, turbulence, no mean wind: largest").ours.value < 0.07
    assert row_of("filament, wall_images: readings").ours.value == pytest.approx(1.0, abs=0.05)
