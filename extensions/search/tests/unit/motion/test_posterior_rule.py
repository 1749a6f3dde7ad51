"""The rule of declaration by the posterior: when a place is declared, and where a mission asks for it."""

import math

import numpy as np
from briefings import briefing, observation, task_of
from plumes import BOUNDS, SOURCE_M, THRESHOLD, lanes, plume_level

from gslcosim.scenario.models.success import DeclarationSuccess
from gslcosim_search.motion.declaration import MissionDeclarer, PosteriorRule
from gslcosim_search.posterior.open_air import OpenAir
from gslcosim_search.posterior.source_posterior import SourcePosterior
from gslcosim_search.senses.instruments import find_noses


def declared(levels, *, wait_s=60.0, latest_s=700.0, wind_m_s=(0.5, 0.0)):
    """The first estimate of a rule along the lanes, asked every ten seconds, and its time."""
    rule = PosteriorRule(SourcePosterior(OpenAir(BOUNDS), threshold=THRESHOLD), wait_s=wait_s, latest_s=latest_s)
    for i, place_m in enumerate([*lanes()] * 4):
        rule.add(float(i), (*place_m, 1.5), levels(place_m), wind_m_s)
        if i % 10 == 0 and (found := rule.estimate(float(i))) is not None:
            return float(i), found
    return None


def test_it_is_declared_when_it_has_stayed_or_when_time_runs_out():
    rng = np.random.default_rng(5)
    early_s, found = declared(lambda place_m: plume_level(place_m, 0.0, rng))
    assert math.dist(found.position_m[:2], SOURCE_M) < 1.5
    assert 0.0 < found.position_m[2] < 3.0
    assert 0.3 < found.confidence < 1.0
    late_s, _ = declared(lambda place_m: plume_level(place_m, 0.0, rng), wait_s=1e6)
    assert early_s < late_s == 700.0


def test_gas_that_no_place_explains_and_air_without_wind_declare_nothing():
    rng = np.random.default_rng(6)
    assert declared(lambda _: float(np.exp(rng.standard_normal()))) is None
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


def test_where_a_mission_asks_the_posterior_goes_before_the_end_of_the_gas():
    assert math.dist(declared_by_mission("by_mission")[:2], SOURCE_M) < 1.0
    end_m = declared_by_mission("never")
    assert end_m != declared_by_mission("by_mission")
    assert declared_by_mission("by_mission", sensors=(("pid", "nose"),)) == declared_by_mission(
        "never", sensors=(("pid", "nose"),)
    )
