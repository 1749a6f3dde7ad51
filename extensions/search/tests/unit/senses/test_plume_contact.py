import math

import pytest
from briefings import briefing, observation

from gslcosim_search.senses.stop_and_measure import Contact, PlumeContactDetector

EAST_RAD = 0.0


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


def test_gas_counts_for_one_question_and_its_place_is_kept():
    plume = watch()
    plume.contact(seen(1, 1.0))
    later = plume.contact(seen(2, 0.0, x_m=7.0))
    assert not later.has_gas
    assert later.gas_m is None
    assert later.last_m == (5.0, 5.0, 2.0)


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


def test_without_an_anemometer_there_is_no_wind():
    plume = PlumeContactDetector(briefing(sensors=(("pid", "nose"),)), threshold_ppm=0.1, threshold_m_s=0.1)
    assert plume.contact(observation(readings={"nose": 1.0})).upwind_rad is None


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
