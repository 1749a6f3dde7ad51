"""Responses of standing sensors: mass, symmetry, walls of the plume, paths, calm air."""

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses


def steady_wind(x_m_s=2.0, y_m_s=0.0, *, across=0.5, up=0.3):
    """Return one period of wind."""
    return WindStatistics(np.array([[x_m_s, y_m_s]]), np.array([across]), np.array([up]))


def test_the_flux_through_a_plane_downwind_is_the_release():
    y, z = np.meshgrid(np.arange(-60, 60, 0.25), np.arange(0.125, 40, 0.25), indexing="ij")
    plane = np.stack([np.full(y.shape, 30.0), y, z], axis=-1).reshape(-1, 3)
    ppm = plume_responses(SensorPaths.of_points(plane), steady_wind(), np.array([0.0, 0.0, 1.5]))
    flux_m3_s = 1e-6 * ppm.sum() * 0.25**2 * 2.0
    assert flux_m3_s == pytest.approx(1.0, rel=1e-4)


def test_the_plume_turns_with_the_wind_and_there_is_none_upwind():
    places = np.array([[20.0, 0.0, 1.0], [0.0, 20.0, 1.0], [-20.0, 0.0, 1.0]])
    sensors, source = SensorPaths.of_points(places), np.zeros(3)
    east = plume_responses(sensors, steady_wind(2.0, 0.0), source)[0]
    north = plume_responses(sensors, steady_wind(0.0, 2.0), source)[0]
    assert east[0] == north[1] > 0.0
    assert east[2] == 0.0


def test_a_path_reads_the_mean_of_its_points():
    instrument, reflector = np.array([30.0, -40.0, 1.6]), np.array([[30.0, 40.0, 1.6]])
    beam = SensorPaths.of_beams(instrument, reflector, n_points=400)
    source = np.array([0.0, 0.0, 0.0])
    points = plume_responses(SensorPaths.of_points(beam.points_m[0]), steady_wind(), source)
    assert plume_responses(beam, steady_wind(), source)[0, 0] == pytest.approx(points.mean())
    # The whole width of the plume over 80 m: an integral across it that is known.
    t, h = 15.0, 1.6
    sigma_z = np.hypot(0.5, 0.3 * t)
    across = 1e6 * 2.0 * np.exp(-0.5 * (h / sigma_z) ** 2) / (np.sqrt(2.0 * np.pi) * sigma_z * 2.0)
    assert plume_responses(beam, steady_wind(), source)[0, 0] == pytest.approx(across / 80.0, rel=1e-3)


def test_fluctuation_across_is_that_of_both_components():
    wind = WindStatistics.of_components(np.array([[0.0, 3.0, 0.1]]), np.array([[0.4, 0.7, 0.2]]))
    assert (wind.across_std_m_s[0], wind.up_std_m_s[0]) == (0.4, 0.2)


def test_calm_air_has_no_answer():
    ppm = plume_responses(SensorPaths.of_points(np.ones((2, 3))), steady_wind(0.0), np.zeros(3))
    assert np.isnan(ppm).all()


def test_rows_that_do_not_fit_are_refused():
    wind = WindStatistics(np.zeros((2, 2)), np.zeros(1), np.zeros(2))
    with pytest.raises(ShapeError, match="of the same n periods"):
        plume_responses(SensorPaths.of_points(np.ones((2, 3))), wind, np.zeros(3))
