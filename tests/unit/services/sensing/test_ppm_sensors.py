import math

import numpy as np
import pytest
from built_messages import build_sample
from surroundings import make_sensor

from gslcosim.base.gases import GASES, PID_LAMPS_EV

STILL = (0.0, 0.0, 0.0)


def values_of(sensor, samples):
    return np.array([sensor.read(s, STILL).values[0] for s in samples])


@pytest.mark.parametrize(
    ("gas", "at_10_6_ev", "at_11_7_ev"),
    [
        ("ethanol", 7.9, 3.1),
        ("propanol", 6.0, 2.7),
        ("chlorine", math.inf, 1.0),
        ("acetone", 1.1, 1.4),
        ("butane", 67.0, 1.2),
    ],
)
def test_a_pid_divides_by_the_correction_factor_of_its_lamp(gas, at_10_6_ev, at_11_7_ev):
    gases = [build_sample(**{gas: 50.0})]
    assert values_of(make_sensor("pid_ideal", lamp_ev=10.6), gases)[0] == pytest.approx(50.0 / at_10_6_ev)
    assert values_of(make_sensor("pid_ideal", lamp_ev=11.7), gases)[0] == pytest.approx(50.0 / at_11_7_ev)
    assert values_of(make_sensor("pid_ideal"), gases)[0] == pytest.approx(50.0 / at_11_7_ev)


def test_a_pid_answers_to_the_gases_below_the_energy_of_its_lamp_and_to_no_others():
    """A factor is none of the energies; 10.47 eV stood for ethanol's factor once."""
    for gas in GASES.values():
        assert {lamp_ev for lamp_ev in PID_LAMPS_EV if gas.ionisation_ev < lamp_ev} == set(gas.pid)
        assert gas.ionisation_ev not in gas.pid.values()


def test_a_pid_adds_gases_and_is_blind_to_some():
    assert values_of(make_sensor("pid_ideal"), [build_sample(methane=1e4, hydrogen=1e4, fluorine=1e4)])[0] == 0.0
    assert values_of(make_sensor("pid_ideal"), [build_sample(acetone=14.0, chlorine=2.0)])[0] == pytest.approx(12.0)


def test_a_threshold_sensor_reads_above_its_threshold_only():
    sensor = make_sensor("threshold", threshold_ppm=2.0)
    assert values_of(sensor, [build_sample(ethanol=x) for x in (1.9, 2.0, 2.1, 30.0)]).tolist() == [0.0, 0.0, 2.1, 30.0]


def test_a_threshold_sensors_noise_is_in_the_gas_only():
    sensor = make_sensor("threshold", threshold_ppm=2.0, noise_std=0.3)
    values = values_of(sensor, [build_sample(ethanol=10.0)] * 2000)
    assert (values.mean(), values.std()) == (pytest.approx(10.0, abs=0.03), pytest.approx(0.3, rel=0.1))
    assert not values_of(sensor, [build_sample(ethanol=1.0)] * 50).any()


def test_a_binary_sensor_distinguishes_gas_from_none():
    sensor = make_sensor("binary", threshold_ppm=1.0)
    assert values_of(sensor, [build_sample(ethanol=0.6), build_sample(ethanol=0.6, methane=0.6)]).tolist() == [0.0, 1.0]


def test_hits_are_poisson_with_a_mean_in_proportion_to_the_gas():
    sensor = make_sensor("hit_counter", hits_per_s_per_ppm=4.0)
    hits = values_of(sensor, [build_sample(ethanol=5.0)] * 4000)
    assert hits.mean() == pytest.approx(2.0, abs=4 * math.sqrt(2.0 / 4000))
    assert hits.var() == pytest.approx(2.0, rel=0.1)
    assert not values_of(sensor, [build_sample(ethanol=0.0)] * 20).any()


def test_an_averaging_sensor_is_the_mean_of_its_time():
    sensor = make_sensor("averaging", averaging_s=0.4)
    values = values_of(sensor, [build_sample(ethanol=x) for x in (8.0, 0.0, 1.0, 3.0, 4.0)])
    assert values.tolist() == [8.0, 4.0, 3.0, 3.0, 2.0]


@pytest.mark.parametrize("times_s", [(1.0, 4.0), (2.0, 2.0), (3.0, 0.5)])
@pytest.mark.parametrize("tick_s", [0.05, 1.0])
def test_a_second_order_sensors_step_response_is_the_closed_form(times_s, tick_s):
    a, b = times_s
    sensor = make_sensor("second_order", tick_s=tick_s, response_s=times_s, recovery_s=times_s)
    t = tick_s * np.arange(1, round(8.0 / tick_s) + 1)
    lag = (
        (1 + t / a) * np.exp(-t / a) if a == b else (a * np.exp(-t / a) - b * np.exp(-t / b)) / (a - b)
    )  # one minus the step response
    np.testing.assert_allclose(values_of(sensor, [build_sample(ethanol=10.0)] * len(t)), 10.0 * (1 - lag), atol=1e-9)
    values_of(sensor, [build_sample(ethanol=10.0)] * round(200.0 / tick_s))
    np.testing.assert_allclose(values_of(sensor, [build_sample()] * len(t)), 10.0 * lag, atol=1e-9)


def test_a_binary_sensors_noise_makes_misses_and_false_alarms():
    sensor = make_sensor("binary", threshold_ppm=1.0, noise_std=0.5)
    hits = values_of(sensor, [build_sample(ethanol=1.0)] * 2000)
    assert set(hits) == {0.0, 1.0}
    assert hits.mean() == pytest.approx(0.5, abs=0.05)


def test_a_slow_hit_counter_loses_no_hits():
    samples = [build_sample(ethanol=5.0)] * 40
    every_tick = values_of(make_sensor("hit_counter", hits_per_s_per_ppm=4.0), samples)
    slow = values_of(make_sensor("hit_counter", hits_per_s_per_ppm=4.0, period_s=0.5), samples)
    np.testing.assert_array_equal(slow[4::5], every_tick.reshape(-1, 5).sum(axis=1))
