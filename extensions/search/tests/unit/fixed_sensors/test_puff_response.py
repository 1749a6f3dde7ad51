"""Puffs in changing wind: the plume in steady wind, mass, memory, gaps, fluctuations by similarity."""

from dataclasses import replace

import numpy as np
import pytest

from gslcosim.base.errors import ShapeError
from gslcosim_search.fixed_sensors.plume_response import SensorPaths, WindStatistics, plume_responses
from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses, surface_fluctuations_m_s

SOURCE_M = np.array([0.0, 0.0, 2.0])


def steady_record(n=8, *, speed=2.0, across=0.3, up=0.2):
    """Return n minutes of the same wind toward x."""
    wind = np.tile([speed, 0.0], (n, 1))
    return WindRecord(60.0 * np.arange(n), 60.0, wind, np.full(n, across), np.full(n, up))


def test_in_steady_wind_puffs_are_the_plume():
    points = np.array([[20.0, 0.0, 2.4], [40.0, 3.0, 2.4], [60.0, -8.0, 1.0]])
    record = steady_record()
    puffs = puff_responses(points, record, SOURCE_M, steps_per_period=60)[-1]
    wind = WindStatistics(record.mean_world_m_s[-1:], record.across_std_m_s[-1:], record.up_std_m_s[-1:])
    plume = plume_responses(SensorPaths.of_points(points), wind, SOURCE_M)[0]
    # Spread along the wind, which the plume leaves out, is worth a few per cent at this turbulence.
    assert puffs == pytest.approx(plume, rel=0.05)


def test_gas_needs_its_time_to_a_sensor_and_is_forgotten_in_a_gap():
    record = steady_record(6, speed=1.0)
    far = puff_responses(np.array([[100.0, 0.0, 2.0]]), record, SOURCE_M)[:, 0]
    assert far[0] < 0.01 * far[-1]
    late = replace(record, start_s=np.array([0, 60, 120, 9000, 9060, 9120.0]))
    again = puff_responses(np.array([[100.0, 0.0, 2.0]]), late, SOURCE_M)[:, 0]
    assert again[3] == pytest.approx(again[0])
    assert again[2] > 50.0 * again[3]


def test_fluctuations_follow_the_surface_layer():
    across, up = surface_fluctuations_m_s(np.array([2.0, 4.0]), 2.4, roughness_m=0.03)
    assert across == pytest.approx([0.3505, 0.7010], rel=1e-3)
    assert across / up == pytest.approx([1.92 / 1.25] * 2)


def test_minutes_without_wind_are_bridged():
    wind = np.array([[1.0, 0.0], [np.nan, np.nan], [3.0, 2.0]])
    record = WindRecord.of_means(np.array([0.0, 60.0, 120.0]), wind, 2.4)
    assert record.mean_world_m_s[1].tolist() == [2.0, 1.0]


def test_rows_that_do_not_fit_are_refused():
    record = WindRecord(np.zeros(2), 60.0, np.zeros((2, 2)), np.zeros(3), np.zeros(2))
    with pytest.raises(ShapeError, match="of the n periods"):
        puff_responses(np.ones((1, 3)), record, SOURCE_M)
