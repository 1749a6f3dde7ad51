"""When a tick may begin, and what is reported of those that were late."""

import pytest

from gslcosim.runtime.stepper import MAX_CAUGHT_UP_S, ClockPace

TICK_NS = 100_000_000


def test_ticks_begin_at_their_time_from_the_first_one_on():
    pace = ClockPace(2.0, TICK_NS)
    assert pace.wait_s(0, 1000.0) == 0.0
    pace.begins(0, 1000.0)
    assert pace.wait_s(1, 1000.0) == pytest.approx(0.05)
    assert pace.wait_s(10, 1000.1) == pytest.approx(0.4)
    assert pace.wait_s(2, 1000.2) == 0.0


def test_small_delays_are_made_up_for():
    pace = ClockPace(1.0, TICK_NS)
    pace.begins(0, 0.0)
    pace.begins(1, 0.35)
    assert pace.wait_s(2, 0.35) == 0.0
    assert pace.wait_s(5, 0.4) == pytest.approx(0.1)
    assert pace.summary() == {"pace": {"factor": 1.0, "worst_lag_s": 0.25, "late_share": 0.5, "lost_s": 0.0}}


def test_a_long_delay_is_lost_and_time_goes_on_from_there():
    pace = ClockPace(1.0, TICK_NS)
    pace.begins(0, 0.0)
    pace.begins(1, 0.1 + 10 * MAX_CAUGHT_UP_S)
    assert pace.wait_s(2, 0.1 + 10 * MAX_CAUGHT_UP_S) == pytest.approx(0.1)
    assert pace.summary()["pace"]["lost_s"] == pytest.approx(10 * MAX_CAUGHT_UP_S)


def test_what_is_repeated_is_not_held_back():
    pace = ClockPace(1.0, TICK_NS, from_tick=100)
    assert all(pace.wait_s(tick, 0.0) == 0.0 for tick in range(101))
    pace.begins(100, 0.0)
    assert pace.wait_s(101, 0.0) == pytest.approx(0.1)
