"""Patchy plumes as measured outdoors, qualitatively (Jones 1983), from the script of docs/studies."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from deadlines import PROCESS_S

SCRIPT = Path(__file__).parents[2] / "docs" / "studies" / "plume_statistics.py"


def test_figures_of_a_series_that_is_known(plume_study):
    ppm = np.zeros(600)
    ppm[100:160] = ppm[300:360] = 5.0
    found = plume_study.statistics_of(ppm)
    assert found.mean_ppm == pytest.approx(1.0)
    assert found.present_frac == pytest.approx(0.2)
    assert found.peak_to_mean == pytest.approx(5.0)
    assert found.relative_std == pytest.approx(2.0)
    assert found.bursts_per_min == pytest.approx(2.0)


def test_a_series_without_gas_has_no_ratios(plume_study):
    found = plume_study.statistics_of(np.zeros(100))
    assert (found.peak_to_mean, found.relative_std, found.present_frac) == (0.0, 0.0, 0.0)


@pytest.mark.slow
def test_gas_comes_in_bursts_that_a_mox_sensor_hides(plume_study):
    truth = plume_study.true_series(seconds=400.0, seed=1)
    near, far = (plume_study.statistics_of(truth[:, i]) for i in (0, 3))
    assert near.mean_ppm > 5 * far.mean_ppm
    assert near.present_frac > 0.7 > 0.5 > far.present_frac > 0.1
    assert far.peak_to_mean > 8.0
    for i in range(truth.shape[1]):
        true, sensed = (
            plume_study.statistics_of(s) for s in (truth[:, i], plume_study.through_sensor(truth[:, i], seed=1))
        )
        assert sensed.peak_to_mean < 0.7 * true.peak_to_mean
        assert sensed.relative_std < 0.7 * true.relative_std
        assert sensed.present_frac >= true.present_frac
        if true.present_frac > 0.25:  # elsewhere its noise makes bursts of its own near the floor
            assert sensed.bursts_per_min < true.bursts_per_min


@pytest.mark.slow
def test_pauses_and_peaks_grow_beside_the_axis(plume_study):
    truth = plume_study.true_series(seconds=600.0, seed=2)
    across = [
        plume_study.statistics_of(truth[:, i]) for i in range(len(plume_study.DISTANCES_M), len(plume_study.PLACES_M))
    ]
    axis, near, far = across[0], across[2], across[3]
    assert axis.present_frac > 1.5 * near.present_frac > 1.5 * far.present_frac > 0.0
    assert far.peak_to_mean > near.peak_to_mean > 1.5 * axis.peak_to_mean


@pytest.mark.slow
def test_the_script_prints_its_table():
    run = subprocess.run(
        [sys.executable, str(SCRIPT), "--seconds", "20"], capture_output=True, text=True, check=True, timeout=PROCESS_S
    )
    assert run.stdout.count("%") == 2 * 10
