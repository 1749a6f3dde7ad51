"""The fit of a straight plume: where its source is, and whether such a plume explains the readings."""

import math

import numpy as np
import pytest
from briefings import briefing, observation, task_of

from gslcosim.contract.messages import Bounds
from gslcosim.scenario.models.success import DeclarationSuccess
from gslcosim_search.motion.declaration import MissionDeclarer, PlumeFitRule
from gslcosim_search.plume_fit import PlumeFit
from gslcosim_search.senses.instruments import find_noses

BOUNDS = Bounds(min_m=(0.0, 0.0, 0.0), max_m=(16.0, 12.0, 3.0))
SOURCE_M = (5.2, 7.3)
THRESHOLD = 0.1


def lanes():
    """Places along lanes two metres apart, one a second at 0.5 m/s."""
    for i, y_m in enumerate(np.arange(1.0, 12.0, 2.0)):
        xs_m = np.arange(0.5, 15.6, 0.5)
        for x_m in xs_m if i % 2 == 0 else xs_m[::-1]:
            yield float(x_m), float(y_m)


def plume_level(place_m, downwind_rad, rng, *, rate=3.0, width_at_source_m=0.4):
    """Level of a plume with lulls, and with levels spread by a factor of two."""
    dx_m, dy_m = place_m[0] - SOURCE_M[0], place_m[1] - SOURCE_M[1]
    x_m = dx_m * math.cos(downwind_rad) + dy_m * math.sin(downwind_rad)
    y_m = dy_m * math.cos(downwind_rad) - dx_m * math.sin(downwind_rad)
    width_m = width_at_source_m + 0.15 * x_m
    if x_m < 0.0 or rng.random() < 0.3:
        return 0.0
    return rate / width_m * math.exp(-0.5 * (y_m / width_m) ** 2 + 0.7 * rng.standard_normal())


@pytest.mark.parametrize("downwind_rad", [0.0, 0.4, -2.0])
@pytest.mark.parametrize("seed", [1, 2])
def test_the_source_of_a_plume_is_found_within_a_metre(downwind_rad, seed):
    rng, fit = np.random.default_rng(seed), PlumeFit(BOUNDS, threshold=THRESHOLD)
    for place_m in lanes():
        fit.add(place_m, plume_level(place_m, downwind_rad, rng), downwind_rad)
    found = fit.best()
    assert math.dist(found.position_m, SOURCE_M) < 1.0
    assert found.advantage_nats > 0.5
    assert found.share > 0.5


def test_a_wind_that_turns_leads_to_the_same_place():
    rng, fit = np.random.default_rng(3), PlumeFit(BOUNDS, threshold=THRESHOLD)
    for i, place_m in enumerate([*lanes(), *lanes()]):
        downwind_rad = 0.0 if i // 90 % 2 == 0 else math.pi / 2.0
        fit.add(place_m, plume_level(place_m, downwind_rad, rng), downwind_rad)
    assert math.dist(fit.best().position_m, SOURCE_M) < 1.0


def test_gas_in_the_whole_room_is_no_plume():
    rng, fit = np.random.default_rng(4), PlumeFit(BOUNDS, threshold=THRESHOLD)
    for place_m in lanes():
        fit.add(place_m, float(np.exp(rng.standard_normal())), 0.0)
    assert fit.best().advantage_nats < 0.0


def test_without_gas_there_is_no_source_and_without_clean_air_one():
    fit = PlumeFit(BOUNDS, threshold=THRESHOLD)
    for place_m in lanes():
        fit.add(place_m, THRESHOLD, 0.0)
    assert fit.best() is None
    fit.add((3.0, 3.0), 1.0, 0.0)
    assert fit.best().n_gas == 1
    only = PlumeFit(BOUNDS, threshold=THRESHOLD)
    only.add((3.0, 3.0), 1.0, 0.0)
    assert math.isfinite(only.best().advantage_nats)


def test_a_large_room_has_larger_cells_and_extreme_levels_stay_finite():
    fit = PlumeFit(Bounds(min_m=(-500.0, -500.0, 0.0), max_m=(500.0, 500.0, 9.0)), threshold=1e-6)
    for level in (0.0, 1e-5, 1e12, 0.0):
        fit.add((400.0, -400.0), level, 1.0)
    assert 0.0 <= fit.best().share <= 1.0


def declared(levels, *, wait_s=60.0, latest_s=540.0, wind_m_s=(0.5, 0.0)):
    """The first estimate of a rule along the lanes, asked every ten seconds, and its time."""
    rule = PlumeFitRule(PlumeFit(BOUNDS, threshold=THRESHOLD), wait_s=wait_s, latest_s=latest_s)
    for i, place_m in enumerate([*lanes(), *lanes(), *lanes()]):
        rule.add(float(i), (*place_m, 1.5), levels(place_m), wind_m_s)
        if i % 10 == 0 and (found := rule.estimate(float(i), 1.5)) is not None:
            return float(i), found
    return None


def test_it_is_declared_when_it_has_stayed_or_when_time_runs_out():
    rng = np.random.default_rng(5)
    early_s, found = declared(lambda place_m: plume_level(place_m, 0.0, rng))
    assert math.dist(found.position_m[:2], SOURCE_M) < 1.0
    assert found.position_m[2] == 1.5
    assert 0.5 < found.confidence < 1.0
    late_s, _ = declared(lambda place_m: plume_level(place_m, 0.0, rng), wait_s=1e6)
    assert early_s < late_s == 540.0


def test_gas_that_no_plume_explains_and_air_without_wind_declare_nothing():
    rng = np.random.default_rng(6)
    assert declared(lambda place_m: float(np.exp(rng.standard_normal()))) is None
    assert declared(lambda place_m: plume_level(place_m, 0.0, rng), wind_m_s=(0.0, 0.0)) is None


def declared_by_mission(plume_fit, *, sensors=(("pid", "nose"), ("anemometer", "vane"))):
    """Where a method that flies lanes through a plume declares its source at the end of the time."""
    one = briefing(sensors=sensors, task=task_of(DeclarationSuccess()))
    declarer = MissionDeclarer(one, find_noses(one)[0], plume_fit=plume_fit)
    rng = np.random.default_rng(8)
    for i, place_m in enumerate(lanes()):
        readings = {"nose": plume_level(place_m, 0.0, rng), "vane": (0.5, math.pi)}
        seen = observation(
            tick=i + 1, position_m=(*place_m, 1.5), readings={name: readings[name] for _, name in sensors}
        )
        declarer.add(seen.model_copy(update={"time_s": float(i + 1)}), math.pi)
    found = declarer.estimate(observation(tick=999, position_m=(1.0, 1.0, 1.5)).model_copy(update={"time_s": 299.0}))
    return found.position_m


def test_where_a_mission_asks_the_fit_goes_before_the_end_of_the_gas():
    assert math.dist(declared_by_mission("by_mission")[:2], SOURCE_M) < 1.0
    end_m = declared_by_mission("never")
    assert end_m != declared_by_mission("by_mission")
    assert declared_by_mission("by_mission", sensors=(("pid", "nose"),)) == declared_by_mission(
        "never", sensors=(("pid", "nose"),)
    )
