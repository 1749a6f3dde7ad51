import math

import pytest
from briefings import observation

from gslcosim_search.reactive.silkmoth import Sidestep, TrueWind
from gslcosim_search.senses.instruments import Vane


def seen(tick, apparent_m_s, velocity_m_s=(0.0, 0.0, 0.0), warming=()):
    speed, upwind = math.hypot(*apparent_m_s), math.atan2(-apparent_m_s[1], -apparent_m_s[0])
    return observation(tick=tick, readings={"vane": (speed, upwind)}, velocity_m_s=velocity_m_s, warming=warming)


def test_a_moving_vehicle_distinguishes_the_wind_from_its_own_motion():
    wind = TrueWind(Vane(name="vane"), smoothing_s=1.0, threshold_m_s=0.1)
    wind.add(seen(1, (0.5 - 1.0, 0.0 - 0.7), velocity_m_s=(1.0, 0.7, 0.0)))
    assert math.remainder(wind.upwind_rad - math.pi, math.tau) == pytest.approx(0.0, abs=1e-9)


def test_the_wind_is_smoothed_with_its_time_constant_whatever_the_step():
    def after(step_ticks):
        wind = TrueWind(Vane(name="vane"), smoothing_s=1.0, threshold_m_s=0.1)
        wind.add(seen(0, (0.5, 0.0)))
        for tick in range(step_ticks, 11, step_ticks):
            wind.add(seen(tick, (0.0, 0.5)))
        return wind.upwind_rad

    assert after(1) == pytest.approx(after(5))
    share = 1.0 - math.exp(-1.0)
    assert after(1) == pytest.approx(math.atan2(-share, -(1.0 - share)))


def test_calm_air_and_a_vane_that_warms_up_give_no_direction():
    wind = TrueWind(Vane(name="vane"), smoothing_s=0.1, threshold_m_s=0.1)
    wind.add(seen(1, (0.01, 0.01)))
    wind.add(seen(2, (5.0, 0.0), warming=("vane",)))
    assert wind.upwind_rad is None
    wind.add(seen(10, (0.5, 0.0)))
    known_rad = wind.upwind_rad
    wind.add(seen(200, (0.0, 0.0)))
    assert wind.upwind_rad == known_rad


def test_it_turns_until_the_way_is_free_and_keeps_the_turn():
    step = Sidestep(side=1, keep_s=3.0)
    turns = []
    for time_s, is_refused in ((0.0, False), (2.0, True), (4.0, True), (6.0, False), (6.9, False), (7.1, False)):
        step.note(time_s, is_refused=is_refused)
        turns.append(step.turn_rad / (math.pi / 4))
    assert turns == pytest.approx([0, 1, 2, 2, 2, 0])
