import math

import briefings
import pytest
from briefings import briefing, observation

from gslcosim.contract.messages import Observation
from gslcosim_search.senses.instruments import Nose, Vane
from gslcosim_search.senses.stop_and_measure import (
    BestProximity,
    Contact,
    GasIncrease,
    MeasuredWind,
    PlumeContactDetector,
    StopAndMeasure,
    TrustedWind,
    local_maxima,
    mean_wind,
    proximity_index,
)

NOSE = Nose(name="nose", unit="ohm", mount_body_m=(0.0, 0.0, 0.0), estimate="nose_ppm")
VANE = Vane(name="vane")
EAST_RAD = 0.0


def shown(
    tick, *, ohm=5e4, ppm=0.0, wind=(1.0, 0.0), status="holding", position_m=(1.0, 2.0, 3.0), warming=()
) -> Observation:
    readings = {"nose": ohm, "nose_ppm": ppm, "vane": wind}
    return briefings.observation(
        tick=tick, position_m=position_m, status=status, asked=False, readings=readings, warming=warming
    )


def test_a_hold_is_averaged_and_the_flight_before_it_is_not():
    stop = StopAndMeasure((NOSE,), VANE)
    stop.add(shown(1, ohm=1.0, status="flying"))
    for tick, (ohm, ppm) in enumerate([(4e4, 1.0), (6e4, 3.0)], start=2):
        stop.add(shown(tick, ohm=ohm, ppm=ppm))
    measured = stop.measured()
    assert measured.values == (5e4,)
    assert measured.ppm == (2.0,)
    assert measured.amounts == pytest.approx(((1 / 4e4 + 1 / 6e4) / 2,))
    assert measured.n_samples == 2
    assert measured.position_world_m == pytest.approx((1.0, 2.0, 3.0))


def test_the_next_hold_begins_afresh_even_where_nobody_saw_the_flight():
    stop = StopAndMeasure((NOSE,))
    stop.add(shown(1, ohm=1e4))
    stop.add(shown(2, ohm=2e4, position_m=(2.0, 2.0, 3.0)))
    assert stop.measured().values == (2e4,)
    stop.add(shown(3, ohm=3e4, position_m=(2.0, 2.0, 3.0), status="flying"))
    assert stop.measured().values == (3e4,)
    stop.add(shown(4, ohm=4e4, position_m=(2.0, 2.0, 3.0)))
    assert stop.measured().values == (4e4,)


def test_a_tick_sent_twice_counts_once_and_a_window_forgets():
    stop = StopAndMeasure((NOSE,), window_s=0.25)
    for tick in (1, 2, 2, 3, 4):
        stop.add(shown(tick, ohm=1e4 * tick))
    assert stop.measured().values == (3e4,)


def test_nothing_is_measured_while_an_instrument_warms_up():
    stop = StopAndMeasure((NOSE,), VANE)
    assert stop.measured() is None
    stop.add(shown(1, warming=("nose",)))
    assert stop.measured() is None
    stop.add(shown(2, ohm=3e4))
    assert stop.measured().values == (3e4,)


def test_a_reading_without_resistance_is_survived():
    stop = StopAndMeasure((NOSE,))
    for tick in (1, 2):
        stop.add(shown(tick, ohm=0.0))
    assert stop.measured().amounts == (math.inf,)


def test_directions_are_averaged_on_the_circle_and_speeds_apart():
    wind = mean_wind([(1.0, math.pi - 0.1), (3.0, -math.pi + 0.1)])
    assert wind.speed_m_s == 2.0
    assert abs(wind.upwind_rad) == pytest.approx(math.pi)
    assert wind.steadiness_frac == pytest.approx(math.cos(0.1))


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
    said = [gas.has_more(shown(tick, ohm=ohm)) for tick, ohm in enumerate([5e4, 4e4, 3.99e4, 3.9e4, 5e4])]
    assert said == [False, True, False, True, False]
    assert gas.value == 5e4


def test_the_mean_over_the_hold_is_compared_where_that_is_asked_for():
    gas = GasIncrease(NOSE, eps=0.0, is_mean=True)
    assert not gas.has_more(shown(1, ohm=5e4))
    gas.add(shown(2, status="flying"))
    for tick, ohm in ((3, 2e4), (4, 6e4)):
        gas.add(shown(tick, ohm=ohm))
    assert gas.has_more(shown(4, ohm=6e4))
    assert gas.value == 4e4


@pytest.mark.parametrize("is_mean", [True, False])
def test_a_sensor_that_warms_up_shows_no_more_gas_and_is_not_compared_with(is_mean):
    gas = GasIncrease(NOSE, eps=0.0, is_mean=is_mean)
    assert not gas.has_more(shown(1, ohm=9e4, warming=("nose",)))
    assert gas.value is None
    assert not gas.has_more(shown(2, ohm=5e4))
    assert gas.has_more(shown(3, ohm=4e4, position_m=(2.0, 2.0, 3.0)))


def watch(model="pid", **changes):
    agent_briefing = briefing(sensors=((model, "nose"), ("anemometer", "vane")))
    return PlumeContactDetector(agent_briefing, **({"threshold_ppm": 0.1, "threshold_m_s": 0.1} | changes))


def seen(tick, nose, *, x_m=5.0, vane=(0.5, EAST_RAD), status="flying"):
    readings = {"nose": nose, "nose_ppm": 0.0, "vane": vane}
    return observation(tick=tick, position_m=(x_m, 5.0, 2.0), readings=readings, status=status)


def test_gas_on_the_way_is_known_at_the_next_question_with_its_place():
    plume = watch()
    for tick in range(10):
        plume.add(seen(tick, 1.0 if 3 <= tick <= 5 else 0.0, x_m=float(tick)))
    contact = plume.contact(seen(10, 0.0, x_m=10.0))
    assert contact.has_gas
    assert contact.gas_m == pytest.approx((4.0, 5.0, 2.0))
    assert contact.last_m == (5.0, 5.0, 2.0)
    assert contact.since_hit_s == pytest.approx(0.5)


def test_the_same_tick_counts_once():
    plume = watch()
    plume.add(seen(1, 1.0))
    plume.contact(seen(1, 1.0))
    assert not plume.contact(seen(1, 1.0)).has_gas


def test_hits_of_a_mox_sensor_belong_to_where_the_vehicle_was_a_second_before():
    plume = watch("tgs2600")
    for tick in range(120):
        plume.add(seen(tick, 50_000.0 * (0.98 ** max(0, tick - 100)), x_m=0.1 * tick))
    contact = plume.contact(seen(120, 20_000.0, x_m=12.0))
    assert contact.has_gas
    assert contact.last_m is not None
    assert contact.last_m[0] == pytest.approx(11.0)


def test_a_direction_is_trusted_only_with_wind_and_kept_in_calm_air():
    plume = watch()
    calm = plume.contact(seen(1, 0.0, vane=(0.01, 2.0), status="holding"))
    assert calm.upwind_rad is None
    windy = plume.contact(seen(2, 0.0, vane=(3.0, 1.0), status="holding"))
    assert windy.upwind_rad is not None
    assert not windy.is_calm
    plume.add(seen(3, 0.0, vane=(0.0, 2.5), status="flying"))
    again = plume.contact(seen(4, 0.0, vane=(0.0, 2.5), status="holding"))
    assert again.is_calm
    assert again.upwind_rad == windy.upwind_rad


def test_a_broken_sensor_gives_no_infinite_amount():
    agent_briefing = briefing(sensors=(("tgs2600", "nose"),)).model_copy()
    plume = PlumeContactDetector(agent_briefing, threshold_ppm=0.1, threshold_m_s=0.1)
    assert plume.contact(observation(readings={"nose": 0.0, "nose_ppm": 1.0e308})).gas_ppm == 1.0e308
    assert math.isfinite(plume.contact(observation(tick=41, readings={"nose": 0.0, "nose_ppm": 0.0})).gas_ppm)


def contact(*, has_gas, last_m):
    return Contact(
        has_gas=has_gas, gas_m=None, last_m=last_m, since_hit_s=0.0, upwind_rad=0.0, is_calm=False, gas_ppm=0.0
    )


def test_the_way_left_shrinks_with_the_distance_from_the_last_gas():
    here_m = (5.0, 5.0, 2.0)
    assert contact(has_gas=True, last_m=here_m).remaining_m(here_m, 0.5) == math.inf
    assert contact(has_gas=False, last_m=None).remaining_m(here_m, 0.5) == -math.inf
    assert contact(has_gas=False, last_m=(5.3, 5.4, 2.0)).remaining_m(here_m, 0.6) == pytest.approx(0.1)


def test_peaks_are_above_what_is_before_and_not_below_what_is_after():
    assert local_maxima([5.0, 1.0, 3.0, 2.0, 4.0, 4.0, 4.0, 1.0, 9.0]) == [3.0, 4.0]
    assert local_maxima([1.0, 2.0]) == local_maxima([]) == []


def test_the_index_of_a_constant_is_its_mean_by_its_weight():
    assert proximity_index([2.0] * 20, 0.1) == pytest.approx(1.0)
    assert proximity_index([], 0.1) == 0.0


def test_bursts_count_more_than_the_same_gas_without():
    calm, bursts = [1.0] * 20, [0.0, 2.0] * 10
    assert sum(calm) == sum(bursts)
    assert proximity_index(calm, 0.1) == pytest.approx(0.5)
    # Nine peaks of 2 that are no end.
    assert proximity_index(bursts, 0.1) == pytest.approx(0.5 + 0.1 * 18.0)


def test_the_best_is_halved_after_more_than_three_misses_in_a_row():
    best = BestProximity(n_misses=3)
    assert best.is_better(8.0)
    assert [best.is_better(1.0) for _ in range(3)] == [False] * 3
    assert best.best == 8.0
    assert not best.is_better(1.0)
    assert best.best == 4.0
    assert best.is_better(5.0)
