import pytest

from gslcosim.base.errors import GslCosimError
from gslcosim.base.ticks import exact_ticks_from_seconds, seconds_from_ticks, ticks_from_seconds

TICK_NS = 100_000_000


def test_seconds_are_derived_without_drift():
    """The millionth tick is where a sum of a million steps would not be."""
    assert seconds_from_ticks(3, TICK_NS) == 0.3
    assert seconds_from_ticks(1_000_000, TICK_NS) == 100_000.0


def test_ticks_from_seconds_takes_the_nearest():
    assert [ticks_from_seconds(duration_s, TICK_NS) for duration_s in (0.0, 0.04, 0.06, 1.0)] == [0, 0, 1, 10]


def test_exact_ticks_accepts_whole_numbers_although_seconds_are_binary():
    assert [exact_ticks_from_seconds(n * 0.1, TICK_NS, name="period_s") for n in range(1, 50)] == list(range(1, 50))


def test_exact_ticks_refuses_the_rest_and_names_both_neighbours():
    with pytest.raises(GslCosimError, match=r"gas\.step_s: expected a whole number of 100 ms ticks, was 0\.25 s"):
        exact_ticks_from_seconds(0.25, TICK_NS, name="gas.step_s")
    with pytest.raises(GslCosimError, match=r"Nearest: 0\.2 s or 0\.3 s"):
        exact_ticks_from_seconds(0.25, TICK_NS, name="gas.step_s")


@pytest.mark.parametrize("duration_s", [0.0, -0.1, 0.04])
def test_exact_ticks_refuses_less_than_one_tick(duration_s):
    with pytest.raises(GslCosimError, match="expected a whole number"):
        exact_ticks_from_seconds(duration_s, TICK_NS, name="period_s")
