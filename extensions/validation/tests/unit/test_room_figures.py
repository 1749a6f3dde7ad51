"""Figures of sensors in a room: onset, growth and whiffs of made-up readings; the floor's polygon."""

import numpy as np
import pytest

from gslcosim.environment.model import Cell
from gslcosim_validation.cases.room_sensors import (
    _is_inside,
    build_room,
    compute_sensor_figures,
    measure_temperature_spread_k,
    simulate_readings,
)
from gslcosim_validation.readers.room_sensors import RoomExperiment, RoomSensors

TIME_S = np.arange(0.0, 6000.0, 1.0)
RELEASE_S, GROWTH_S = 300.0, 600.0


def made_up(*, ripple=0.0):
    """Return readings of six sensors that begin a minute apart and grow alike, with noise and a ripple of 30 s."""
    rng = np.random.default_rng(2)
    begin_s = RELEASE_S + 60.0 * np.arange(1, 7)
    since_s = np.maximum(TIME_S[:, None] - begin_s, 0.0)
    level = 1.0 - np.exp(-since_s / GROWTH_S)
    wave = 1.0 + ripple * np.sign(np.sin(2.0 * np.pi * TIME_S / 30.0))[:, None]
    return 0.3 + level * wave + rng.normal(0.0, 0.002, (len(TIME_S), 6))


def test_onsets_are_in_order_and_growth_is_that_of_the_room():
    found = compute_sensor_figures(TIME_S, made_up(), quiet_until_s=RELEASE_S)
    assert np.diff(found.onset_s) == pytest.approx([60.0] * 5, abs=12.0)
    # The mean of the sensors reaches 63 % of its plateau GROWTH_S after it began; the fifth sensor later than that.
    assert found.growth_s == pytest.approx(GROWTH_S - 90.0, abs=90.0)


def test_whiffs_are_counted_without_trend_and_smooth_readings_have_none():
    lively = compute_sensor_figures(TIME_S, made_up(ripple=0.8), quiet_until_s=RELEASE_S)
    assert lively.whiffs_per_min == pytest.approx([2.0] * 6, abs=0.1)
    assert lively.intensity == pytest.approx([0.8] * 6, rel=0.05)
    smooth = compute_sensor_figures(TIME_S, made_up(), quiet_until_s=RELEASE_S)
    assert smooth.whiffs_per_min.max() == 0.0
    assert smooth.intensity.max() < 0.05


def test_a_sensor_that_does_not_react_has_no_figures():
    readings = made_up()
    readings[:, 5] = 0.3 + np.random.default_rng(4).normal(0.0, 0.002, len(TIME_S))
    found = compute_sensor_figures(TIME_S, readings, quiet_until_s=RELEASE_S)
    assert np.isnan(found.intensity).tolist() == [False] * 5 + [True]


def test_cells_behind_a_slanted_wall_are_outside():
    corners_m = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 4.0], [0.0, 2.0]])
    inside = _is_inside(corners_m, np.array([0.5, 3.0]), np.array([1.0, 3.5]))
    assert inside.tolist() == [[True, False], [True, True]]


def experiment_with(*temperatures_c):
    return RoomExperiment(
        number=1,
        source_m=(1.0, 1.0, 0.0),
        airflow="off",
        is_window_open=False,
        time_s=np.arange(3.0),
        readings_ppm=np.zeros((3, 1)),
        temperature_c=np.tile(np.array(temperatures_c, dtype=float), (3, 1)),
        wind_m_s=np.zeros(3),
        gas_seen_s=1.0,
    )


def room_with(*experiments):
    return RoomSensors(
        corners_m=np.array([[0, 0], [3, 0], [3, 2.5], [0, 2.5]], dtype=float),
        height_m=2.5,
        supply_m=None,
        window_m=((3.0, 0.9, 1.1), (3.0, 1.6, 1.9)),
        sensors=("c_0",),
        positions_m=np.array([[1.5, 1.2, 1.3]]),
        plateau_ratio=np.ones(1),
        experiments=experiments,
    )


def test_heat_is_estimated_from_temperatures_alone():
    spread_k = measure_temperature_spread_k(
        room_with(experiment_with(20.0, 21.0), experiment_with(), experiment_with(20, 20))
    )
    assert spread_k == pytest.approx(0.5 * 2**-0.5)
    assert measure_temperature_spread_k(room_with(experiment_with())) == 0.0


@pytest.mark.slow
def test_the_warm_wall_moves_the_air_and_gas_leaves_with_it(monkeypatch):
    monkeypatch.setattr("gslcosim_validation.cases.room_sensors.SOLVE_S", 40.0)
    monkeypatch.setattr("gslcosim_validation.cases.room_sensors.MEAN_FROM_S", 20.0)
    warm, even = (room_with(experiment_with(20.0, high_c)) for high_c in (20.8, 20.0))
    environment = build_room(warm)
    assert (environment.occupancy == Cell.OUTLET).sum() == 4
    rising_m_s = environment.wind.velocity_m_s[0, -1, 3:7, 4, 2].mean()
    assert rising_m_s > 0.05 > build_room(even).wind.velocity_m_s[0, -1, 3:7, 4, 2].mean()
    readings = simulate_readings(warm, environment, warm.experiments[0], 3200.0)[:, 0]
    # Air is exchanged in 450 s. Were all gas kept, the last quarter would have 2.3 times that of the second.
    assert readings[-400:].mean() < 1.7 * readings[400:800].mean()
