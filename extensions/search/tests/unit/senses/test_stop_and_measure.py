import math

import briefings
import pytest

from gslcosim.contract.messages import Observation
from gslcosim_search.senses.instruments import Nose, Vane
from gslcosim_search.senses.stop_and_measure import (
    GasIncrease,
    MeasuredWind,
    StopAndMeasure,
    TrustedWind,
    circular_mean_rad,
    mean_wind,
)

NOSE = Nose(name="nose", unit="ohm", mount_body_m=(0.0, 0.0, 0.0), estimate="nose_ppm")
VANE = Vane(name="vane")


def observation(
    tick, *, ohm=5e4, ppm=0.0, wind=(1.0, 0.0), status="holding", position_m=(1.0, 2.0, 3.0), warming=()
) -> Observation:
    readings = {"nose": ohm, "nose_ppm": ppm, "vane": wind}
    return briefings.observation(
        tick=tick, position_m=position_m, status=status, asked=False, readings=readings, warming=warming
    )


def test_a_hold_is_averaged_and_the_flight_before_it_is_not():
    stop = StopAndMeasure((NOSE,), VANE)
    stop.add(observation(1, ohm=1.0, status="flying"))
    for tick, (ohm, ppm) in enumerate([(4e4, 1.0), (6e4, 3.0)], start=2):
        stop.add(observation(tick, ohm=ohm, ppm=ppm))
    measured = stop.measured()
    assert measured.values == (5e4,)
    assert measured.ppm == (2.0,)
    assert measured.amounts == pytest.approx(((1 / 4e4 + 1 / 6e4) / 2,))
    assert measured.n_samples == 2
    assert measured.position_world_m == pytest.approx((1.0, 2.0, 3.0))


def test_the_next_hold_begins_afresh_even_where_nobody_saw_the_flight():
    stop = StopAndMeasure((NOSE,))
    stop.add(observation(1, ohm=1e4))
    stop.add(observation(2, ohm=2e4, position_m=(2.0, 2.0, 3.0)))
    assert stop.measured().values == (2e4,)
    stop.add(observation(3, ohm=3e4, position_m=(2.0, 2.0, 3.0), status="flying"))
    assert stop.measured().values == (3e4,)
    stop.add(observation(4, ohm=4e4, position_m=(2.0, 2.0, 3.0)))
    assert stop.measured().values == (4e4,)


def test_a_tick_sent_twice_counts_once_and_a_window_forgets():
    stop = StopAndMeasure((NOSE,), window_s=0.25)
    for tick in (1, 2, 2, 3, 4):
        stop.add(observation(tick, ohm=1e4 * tick))
    assert stop.measured().values == (3e4,)


def test_nothing_is_measured_while_an_instrument_warms_up():
    stop = StopAndMeasure((NOSE,), VANE)
    assert stop.measured() is None
    stop.add(observation(1, warming=("nose",)))
    assert stop.measured() is None
    stop.add(observation(2, ohm=3e4))
    assert stop.measured().values == (3e4,)


def test_a_reading_without_resistance_is_survived():
    stop = StopAndMeasure((NOSE,))
    for tick in (1, 2):
        stop.add(observation(tick, ohm=0.0))
    assert stop.measured().amounts == (math.inf,)


def test_directions_are_averaged_on_the_circle_and_speeds_apart():
    wind = mean_wind([(1.0, math.pi - 0.1), (3.0, -math.pi + 0.1)])
    assert wind.speed_m_s == 2.0
    assert abs(wind.upwind_rad) == pytest.approx(math.pi)
    assert wind.steadiness_frac == pytest.approx(math.cos(0.1))


def test_opposite_directions_do_not_agree():
    assert circular_mean_rad([0.3, 0.3 + math.pi])[1] == pytest.approx(0.0, abs=1e-15)
    assert circular_mean_rad([]) == (0.0, 0.0)


def test_calm_air_leaves_the_last_direction_that_was_trusted():
    trusted = TrustedWind(threshold_m_s=0.1, least_steadiness_frac=0.5)
    assert trusted.add(MeasuredWind(speed_m_s=0.05, upwind_rad=1.0)) is None
    assert trusted.is_calm
    assert trusted.add(MeasuredWind(speed_m_s=0.5, upwind_rad=2.0)) == 2.0
    assert not trusted.is_calm
    assert trusted.add(MeasuredWind(speed_m_s=0.0, upwind_rad=3.0)) == 2.0
    assert trusted.add(MeasuredWind(speed_m_s=1.0, upwind_rad=3.0, steadiness_frac=0.4)) == 2.0
    assert trusted.is_calm


def test_the_gas_of_a_decision_is_compared_with_that_of_the_one_before():
    gas = GasIncrease(NOSE, eps=0.01, is_mean=False)
    said = [gas.has_more(observation(tick, ohm=ohm)) for tick, ohm in enumerate([5e4, 4e4, 3.99e4, 3.9e4, 5e4])]
    assert said == [False, True, False, True, False]
    assert gas.value == 5e4


def test_the_mean_over_the_hold_is_compared_where_that_is_asked_for():
    gas = GasIncrease(NOSE, eps=0.0, is_mean=True)
    assert not gas.has_more(observation(1, ohm=5e4))
    gas.add(observation(2, status="flying"))
    for tick, ohm in ((3, 2e4), (4, 6e4)):
        gas.add(observation(tick, ohm=ohm))
    assert gas.has_more(observation(4, ohm=6e4))
    assert gas.value == 4e4


@pytest.mark.parametrize("is_mean", [True, False])
def test_a_sensor_that_warms_up_shows_no_more_gas_and_is_not_compared_with(is_mean):
    gas = GasIncrease(NOSE, eps=0.0, is_mean=is_mean)
    assert not gas.has_more(observation(1, ohm=9e4, warming=("nose",)))
    assert gas.value is None
    assert not gas.has_more(observation(2, ohm=5e4))
    assert gas.has_more(observation(3, ohm=4e4, position_m=(2.0, 2.0, 3.0)))
