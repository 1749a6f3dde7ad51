"""Plumes of gas models in an open field, as records that can be scored, and their case on the page."""

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from gslcosim_validation import read_measured
from gslcosim_validation.cases import load_case
from gslcosim_validation.cases.gas_models import farthest_distance
from gslcosim_validation.gas_models import (
    DISTANCES_M,
    GAS_SETTINGS,
    TIME_SCALE_S,
    VELOCITY_STD_M_S,
    disperse_pairs,
    record_plume,
    score_plume,
)
from gslcosim_validation.plume_statistics import score_absolute_dispersion
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


def test_the_preset_of_the_page_on_gas_is_what_is_scored():
    page = (Path(__file__).parents[4] / "docs" / "gas.md").read_text(encoding="utf-8")
    block = page.split("Preset: plumes as measured")[1].split("```")[1].removeprefix("yaml")
    assert yaml.safe_load(block)["gas"]["turbulence"] == dict(GAS_SETTINGS["filament, turbulence"]["turbulence"])


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
def test_the_case_has_a_row_for_each_model_and_law(tmp_path):
    entry = {"id": "richardson_constant", "values": {"g": 0.5}}
    (tmp_path / "published.json").write_text(json.dumps({"entries": [entry]}))
    result = load_case("gas-models").run(read_measured(tmp_path), "quick")
    assert len(result.rows) == 5 * len(GAS_SETTINGS) + 2 * 3 + 4 + 2
    assert all(row.if_missed for row in result.rows)

    def value_of(text):
        (row,) = [row for row in result.rows if row.quantity.startswith(text)]
        return row.ours.value

    assert value_of("filament, turbulence: variance of tracers") == pytest.approx(1.0, abs=0.5)
    assert value_of("filament: variance of tracers") < 0.1
    assert value_of("filament, turbulence, no mean wind: largest") < 0.07
    assert value_of("filament: readings beside walls") < 0.8
    assert value_of("filament, wall_images: readings") == pytest.approx(1.0, abs=0.05)
