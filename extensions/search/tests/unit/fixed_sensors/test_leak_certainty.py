"""Leaks of which a network is unsure, and rates that its model cannot tell."""

import math

import numpy as np
import pytest
from mast_campaigns import MASTS_M, N_MINUTES, PLACES_M

from gslcosim_search.fixed_sensors.events import Excess, detect_events, find_excess
from gslcosim_search.fixed_sensors.leak_location import bounded_rate, locate_among, locate_event, locate_sources
from gslcosim_search.fixed_sensors.puff_response import WindRecord, puff_responses

MASTS = np.array([[*place_m, 2.4] for place_m in MASTS_M.values()])
PLACES = {name: np.array([*place_m, 2.0]) for name, place_m in PLACES_M.items()}
RATE_M3_S = 8e-4
CLOCK_S = 60.0 * np.arange(N_MINUTES)


def record(angle_rad, place="well", rate_m3_s=RATE_M3_S):
    """Return the wind, the excess and the one event of a leak of two hours, in wind of given directions."""
    wind = WindRecord.of_means(CLOCK_S, 2.5 * np.column_stack([np.cos(angle_rad), np.sin(angle_rad)]), 2.4)
    is_open = (np.arange(N_MINUTES) >= 240) & (np.arange(N_MINUTES) < 360)
    readings = 2.0 + np.random.default_rng(1).normal(0.0, 0.01, (N_MINUTES, len(MASTS)))
    readings += np.where(is_open[:, None], rate_m3_s * puff_responses(MASTS, wind, PLACES[place]), 0.0)
    excess = find_excess(CLOCK_S, readings)
    (event,) = detect_events(CLOCK_S, excess)
    return wind, excess, event


TURNING = 0.5 + 0.9 * np.sin(np.arange(N_MINUTES) / 17.0)


def test_a_leak_that_one_place_alone_explains_is_sure():
    wind, excess, event = record(TURNING)
    found = locate_among(event, excess, wind, MASTS, PLACES)
    assert found.place == "well"
    assert (found.certainty.is_unsure, found.certainty.runner_up) == (False, "tank")
    margin = found.correlation["well"] - found.correlation["tank"]
    assert found.certainty.margin == pytest.approx(margin)
    assert not found.is_upper_bound


def test_places_that_explain_a_leak_alike_are_unsure():
    wind, excess, event = record(TURNING)
    twin = PLACES["well"] + np.array([0.3, 0.2, 0.0])
    found = locate_among(event, excess, wind, MASTS, {**PLACES, "twin": twin})
    assert found.certainty.is_unsure
    assert {found.place, found.certainty.runner_up} == {"well", "twin"}
    assert 0.0 <= found.certainty.margin < 0.01


@pytest.mark.parametrize("places_m", [{"well": PLACES["well"]}, PLACES])
def test_without_wind_nothing_is_sure_but_the_only_place(places_m):
    wind, excess, event = record(TURNING)
    wind.mean_world_m_s[:] = np.nan
    found = locate_event(event, excess, wind, MASTS, places_m, source_height_m=2.0)
    assert found.certainty.is_unsure == (len(places_m) > 1)


def test_a_rate_that_rests_on_the_tail_of_a_plume_is_an_upper_bound():
    """Wind that is steady and, as measured, 40 degrees off carries the plume past the mast that reads it."""
    towards = math.atan2(28.0 - 10.0, 28.0 - 15.0)
    wind, excess, event = record(np.full(N_MINUTES, towards))
    places_m = {"well": PLACES["well"]}
    clear = locate_among(event, excess, wind, MASTS, places_m)
    assert not clear.is_upper_bound
    assert clear.rate_m3_s == pytest.approx(RATE_M3_S, rel=0.3)
    angle = np.full(N_MINUTES, towards + 0.7)
    off = WindRecord.of_means(CLOCK_S, 2.5 * np.column_stack([np.cos(angle), np.sin(angle)]), 2.4)
    near = [list(MASTS_M).index("e")]
    alone = Excess(excess.above_ppm[:, near], excess.noise_ppm[near], excess.counts)
    bound = locate_among(event, alone, off, MASTS[near], places_m)
    assert bound.is_upper_bound
    assert bound.rate_m3_s > RATE_M3_S


def test_bounds_follow_from_the_tail_and_from_noise():
    response, noise = np.full((40, 2), 100.0), np.full(2, 0.1)
    gas = np.full((40, 2), 0.5)
    exact = bounded_rate(response, response, gas, noise)
    assert (exact.rate_m3_s, exact.is_upper_bound) == (pytest.approx(5e-3), False)
    tail = bounded_rate(response, 10.0 * response, gas, noise)
    assert (tail.rate_m3_s, tail.is_upper_bound) == (pytest.approx(5e-4), True)
    # Noise of 80 readings is 0.1 sqrt(80) in the sum: twice that is what could hide.
    silent = bounded_rate(response, response, np.zeros((40, 2)), noise)
    assert (silent.rate_m3_s, silent.is_upper_bound) == (pytest.approx(0.2 * math.sqrt(80) / 8000.0), True)
    nothing = bounded_rate(np.zeros((40, 2)), response, gas, noise)
    assert math.isnan(nothing.rate_m3_s)


@pytest.mark.parametrize("beside", [None, "tank"])
def test_an_event_names_all_places_that_were_open(beside):
    wind, excess, event = record(TURNING)
    if beside is not None:
        more = 0.6 * RATE_M3_S * puff_responses(MASTS, wind, PLACES[beside])
        is_open = (np.arange(N_MINUTES) >= 240) & (np.arange(N_MINUTES) < 360)
        readings = excess.above_ppm + np.where(is_open[:, None], more, 0.0)
        excess = find_excess(CLOCK_S, readings)
        (event,) = detect_events(CLOCK_S, excess)
    third = {"far": np.array([-35.0, 30.0, 2.0])}
    found = locate_sources(event, excess, wind, MASTS, {**PLACES, **third}, source_height_m=2.0)
    truth = {"well": RATE_M3_S} if beside is None else {"well": RATE_M3_S, beside: 0.6 * RATE_M3_S}
    assert {each.place for each in found} == set(truth)
    for each in found:
        assert each.rate_m3_s == pytest.approx(truth[each.place], rel=0.3)
        assert not each.certainty.is_unsure
