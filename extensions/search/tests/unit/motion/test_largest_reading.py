import math

import pytest
from briefings import briefing, observation

from gslcosim_search.motion.largest_reading import LargestReading

SPEED_M_S, STEP_S = 0.5, 0.1


def fly_past(reading: LargestReading, shown, *, until_s: float = 60.0, **changes) -> LargestReading:
    """Fly along x at 0.5 m/s; `shown` is what the sensor shows at a time [s]."""
    for i in range(round(until_s / STEP_S)):
        time_s = i * STEP_S
        place_m = (SPEED_M_S * time_s, 5.0, 2.0)
        reading.add(observation(tick=i, position_m=place_m, readings={"nose": shown(time_s)}, **changes))
    return reading


def lagged(true_at, tau_s: float):
    """Return what a sensor with a first-order lag shows of a true course."""
    shown, y = {}, true_at(0.0)
    for i in range(2000):
        y += (1.0 - math.exp(-STEP_S / tau_s)) * (true_at(i * STEP_S) - y)
        shown[i] = y
    return lambda time_s: shown[round(time_s / STEP_S)]


def bump(time_s: float) -> float:
    """A plume 2 m wide that is crossed after 30 s, at x = 15 m."""
    return 5.0 * math.exp(-((time_s - 30.0) ** 2) / (2.0 * 4.0**2))


@pytest.mark.parametrize(
    ("model", "tau_s", "show"),
    [
        ("pid", 3.0 / math.log(10.0), lambda c: c),
        ("tgs2600", 4.8, lambda c: 50_000.0 / (1.0 + c)),
        ("tdlas", 0.05, lambda c: 40.0 * c),
    ],
)
def test_the_place_of_the_largest_reading_is_that_of_the_gas_whatever_the_lag(model, tau_s, show):
    reading = LargestReading(briefing(sensors=((model, "nose"),)))
    course = lagged(bump, tau_s)
    found = fly_past(reading, lambda time_s: show(course(time_s))).estimate()
    assert found is not None
    assert found.position_m == pytest.approx((15.0, 5.0, 2.0), abs=0.9)
    assert 0.8 < found.confidence < 1.0


def test_without_correction_a_slow_sensor_misplaces_the_gas_by_its_lag():
    reading = LargestReading(briefing(sensors=(("tgs2600", "nose"),)), lag_s=0.0)
    course = lagged(bump, 4.8)
    found = fly_past(reading, lambda time_s: 50_000.0 / (1.0 + course(time_s))).estimate()
    assert found is not None
    assert found.position_m[0] > 16.5


def test_one_wild_reading_counts_less_than_gas_that_lasts():
    def shown(time_s: float) -> float:
        return 6.0 if round(time_s / STEP_S) == 100 else bump(time_s)

    found = fly_past(LargestReading(briefing(sensors=(("pid", "nose"),))), shown).estimate()
    assert found is not None
    assert found.position_m[0] == pytest.approx(15.0, abs=0.8)


@pytest.mark.parametrize("shown", [0.0, 0.09])
def test_no_gas_is_no_estimate(shown):
    assert fly_past(LargestReading(briefing(sensors=(("pid", "nose"),))), lambda _: shown).estimate() is None


def test_a_cold_sensor_and_a_vehicle_without_one_say_nothing():
    cold = fly_past(LargestReading(briefing(sensors=(("pid", "nose"),))), lambda _: 5.0, warming=("nose",))
    blind = fly_past(LargestReading(briefing(sensors=(("anemometer", "nose"),))), lambda _: 5.0)
    assert cold.estimate() is None
    assert blind.estimate() is None


def test_a_laser_is_read_before_a_nose():
    reading = LargestReading(briefing(sensors=(("pid", "nose"), ("tdlas", "beam"))))
    for i in range(100):
        values = {"nose": 9.0 if i < 50 else 0.0, "beam": 0.0 if i < 50 else 80.0}
        reading.add(observation(tick=i, position_m=(float(i), 0.0, 2.0), readings=values))
    found = reading.estimate()
    assert found is not None
    assert found.position_m[0] > 50.0
