import math

import numpy as np
import pytest
from built_messages import build_observation

from gslcosim.contract import keys
from gslcosim.contract.messages import Reading
from gslcosim.scenario.loader import load_scenario
from gslcosim_bench.execution.scoring import SeriesCollector, counted_time_s, score


def test_the_score_by_hand():
    assert score(success=True, time_s=0.0, limit_s=300.0) == 1.0
    assert score(success=True, time_s=150.0, limit_s=300.0) == 0.75
    assert score(success=True, time_s=300.0, limit_s=300.0) == 0.5
    assert score(success=False, time_s=300.0, limit_s=300.0) == 0.0


def test_each_false_declaration_halves_the_score_and_a_collision_takes_it():
    assert score(success=True, time_s=150.0, limit_s=300.0, n_false_declarations=2) == 0.75 / 4
    assert score(success=True, time_s=150.0, limit_s=300.0, n_collisions=1) == 0.0


def test_the_score_is_from_0_to_1_and_never_rises_with_time_or_mistakes():
    rng = np.random.default_rng(1)
    for _ in range(200):
        early_s, late_s = np.sort(rng.uniform(0.0, 300.0, 2))
        n = int(rng.integers(0, 4))
        better = score(success=True, time_s=early_s, limit_s=300.0, n_false_declarations=n)
        worse = score(success=True, time_s=late_s, limit_s=300.0, n_false_declarations=n + int(rng.integers(0, 2)))
        assert 0.0 < worse <= better <= 1.0


def test_failures_count_the_limit_and_successes_no_more():
    assert counted_time_s(success=True, time_to_source_s=42.0, limit_s=300.0) == 42.0
    assert counted_time_s(success=True, time_to_source_s=301.0, limit_s=300.0) == 300.0
    assert counted_time_s(success=False, time_to_source_s=None, limit_s=300.0) == 300.0
    # An agent can come to the source and its run still count as failed, where a declaration was asked for.
    assert counted_time_s(success=False, time_to_source_s=42.0, limit_s=300.0) == 300.0


@pytest.mark.parametrize(("time_s", "limit_s"), [(-1.0, 300.0), (301.0, 300.0), (math.nan, 300.0), (0.0, 0.0)])
def test_a_time_out_of_its_range_is_refused(time_s, limit_s):
    with pytest.raises(ValueError, match="limit"):
        score(success=True, time_s=time_s, limit_s=limit_s)


@pytest.mark.parametrize(
    ("quantity", "unit"), [("path_integrated_mixing_ratio", "ppm m"), ("resistance", "ohm"), ("hits", "1")]
)
def test_the_reading_of_a_track_is_that_of_the_first_gas_sensor_whatever_its_kind(quantity, unit):
    collector = SeriesCollector(load_scenario("tiny_room").scenario)
    (agent,) = collector.agents
    readings = (
        Reading(sensor="wind", quantity="apparent_wind", unit="m/s, rad", values=(0.5, 1.0)),
        Reading(sensor="first", quantity=quantity, unit=unit, values=(7.0,)),
        Reading(sensor="second", quantity="mixing_ratio", unit="ppm", values=(9.0,)),
    )
    observation = build_observation(1, agent=agent, readings=readings)
    collector.note(keys.observation(agent), observation)
    assert collector.agents[agent].last_reading == 7.0
