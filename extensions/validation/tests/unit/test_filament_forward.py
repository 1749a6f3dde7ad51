"""Filaments of a run beside masts and lasers: the flow of sources, the wind of each period, and pairs by set."""

from dataclasses import replace

import numpy as np
import pytest
from laser_campaigns import write_lasers
from mast_campaigns import write_campaign

from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_services.fields.turbulence.air import k_epsilon_from_intensity, lagrangian_time_s
from gslcosim_validation import read_measured
from gslcosim_validation.cases import load_case
from gslcosim_validation.cases.filament_forward import MOST_KG_S, Release, list_mast_releases, simulate_release
from gslcosim_validation.plume_statistics import taylor_variance_m2
from gslcosim_validation.readers.mast_network import MastNetwork

SOURCE_M = (0.0, 0.0, 2.0)
FLOW_M3_S = 1e-3


def a_release(*points_m, wind_m_s=((2.0, 0.0),), n=6, sources=((SOURCE_M, FLOW_M3_S),)):
    wind = np.resize(np.array(wind_m_s), (n, 2))
    points = np.array(points_m)[:, None, :]
    return Release(
        name="1",
        sources=sources,
        points_m=points,
        wind_m_s=wind,
        intensity_frac=0.15,
        above_ppm=np.zeros((n, len(points_m))),
    )


def test_eddies_are_half_as_long_as_instruments_are_high():
    assert a_release((20.0, 0.0, 3.0)).length_m == 1.5


def test_the_mean_downwind_is_that_of_a_plume_of_taylors_width_and_upwind_there_is_nothing():
    points_m = [(8.0, 0.0, 2.0), (-8.0, 0.0, 2.0), (8.0, 30.0, 2.0)]
    readings = simulate_release(a_release(*points_m, n=25), period_s=60.0, seed=3)
    assert readings.shape == (25, 3)
    # Gas passes 8 m in 4 s; a plume whose spread is that of a fluctuation times time.
    scale_s = lagrangian_time_s(*k_epsilon_from_intensity(0.3, 1.0))
    std = np.sqrt(taylor_variance_m2(np.array([4.0]), velocity_std_m_s=0.3, time_scale_s=scale_s)) / 4.0
    wind = WindStatistics(np.array([[2.0, 0.0]]), std, std)
    plume = FLOW_M3_S * plume_responses(SensorPaths.of_points(np.array(points_m)), wind, np.array(SOURCE_M))[0]
    assert readings[:, 0].mean() == pytest.approx(plume[0], rel=0.3)
    assert readings[:, 1:].max() < 1e-3 * readings[:, 0].mean()


def test_the_wind_of_each_period_carries_the_gas():
    east, north = (12.0, 0.0, 2.0), (0.0, 12.0, 2.0)
    turning = np.repeat([[2.0, 0.0], [0.0, 2.0]], 6, axis=0)
    readings = simulate_release(a_release(east, north, wind_m_s=turning, n=12), period_s=60.0, seed=3)
    before, after = readings[:6].mean(axis=0), readings[8:].mean(axis=0)
    assert before[0] > 100.0 * before[1]
    assert after[1] > 100.0 * after[0]


def test_two_sources_of_half_the_flow_are_one():
    one = simulate_release(a_release((8.0, 0.0, 2.0), n=20), period_s=60.0, seed=3)
    halves = ((SOURCE_M, 0.5 * FLOW_M3_S),) * 2
    two = simulate_release(a_release((8.0, 0.0, 2.0), n=20, sources=halves), period_s=60.0, seed=4)
    assert two.mean() == pytest.approx(one.mean(), rel=0.2)


@pytest.mark.slow
def test_masts_in_a_plume_of_puffs_are_within_two_of_filaments(yard):
    result = load_case("filament-forward").run(read_measured(yard), "full")
    mean, intensity = result.pairs
    assert (mean["measured_set"], mean["release"], mean["quantity"]) == ("our_yard", "1", "mean")
    assert mean["kind_of_air"] == "open_ground"
    ratios = np.array(mean["modelled"]) / np.array(mean["measured"])
    assert 0.5 < np.exp(np.log(ratios).mean()) < 2.0
    assert len(intensity["modelled"]) <= len(mean["modelled"])
    assert result.rows[0].quantity == f"1 releases: FAC2 of {len(ratios)} means at instruments"


@pytest.mark.slow
def test_beams_are_means_along_their_paths(tmp_path):
    result = load_case("filament-forward").run(read_measured(write_lasers(tmp_path / "field")), "quick")
    (mean,) = [each for each in result.pairs if each["quantity"] == "mean"]
    assert mean["release"] == "r1"
    # The first beam crosses the plume in the first half hour, above a background of 2 ppm.
    assert mean["measured"][0] == pytest.approx(0.75, rel=0.01)
    assert 0.1 < mean["modelled"][0] / mean["measured"][0] < 10.0


def test_stacks_of_which_one_was_in_use_share_the_flow(yard):
    data = read_measured(yard)
    network = data.read(data.sets[0], MastNetwork)
    (known,) = list_mast_releases(network)
    stacks_m = {"short": (15.0, 10.0, 3.0), "tall": (15.0, 10.0, 7.0)}
    nameless = replace(network.releases[0], place=None, position_m=None)
    (release,) = list_mast_releases(replace(network, places_m=stacks_m, releases=(nameless,)))
    assert [place_m for place_m, _ in release.sources] == list(stacks_m.values())
    assert [flow for _, flow in release.sources] == pytest.approx([0.5 * known.sources[0][1]] * 2)


def test_jets_are_left_out(tmp_path):
    strong = write_campaign(tmp_path / "jet", rate_kg_h=1.1 * 3600.0 * MOST_KG_S)
    assert load_case("filament-forward").run(read_measured(strong), "full").pairs == []
