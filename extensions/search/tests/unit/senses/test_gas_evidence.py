"""Findings of one nose: gas, clean air, or neither, and where."""

import math

import numpy as np
import pytest
from briefings import observation

from gslcosim_search.senses.hit_detection import GasEvidence
from gslcosim_search.senses.instruments import Nose

PID = Nose(name="nose", unit="ppm", mount_body_m=(0.0, 0.0, 0.0))
MOX = Nose(name="nose", unit="ohm", mount_body_m=(0.0, 0.0, 0.0))
CLEAN_OHM, DECAY_S = 50_000.0, 18.75


def findings(nose, values, *, speed_m_s=0.0, warming=range(0), **options):
    """What is found, by tick, when the nose shows these values at ticks 0, 1, ... of a vehicle that flies along x."""
    evidence = GasEvidence(nose, **options)
    found = {}
    for tick, value in enumerate(values):
        seen = observation(
            tick=tick,
            position_m=(speed_m_s * tick / 10.0, 5.0, 2.0),
            readings={"nose": value},
            warming=("nose",) if tick in warming else (),
        )
        if (finding := evidence.add(seen)) is not None:
            found[tick] = finding
        assert evidence.add(seen) is None
    return found


def recovering(ticks, lowest=0.5):
    """The resistance of a MOX sensor that is left by gas at tick 0, as a share of clean air's."""
    return [CLEAN_OHM * (1.0 - (1.0 - lowest) * math.exp(-tick / 10.0 / DECAY_S)) for tick in range(ticks)]


def entering(ticks, lowest=0.5, rise_s=4.8):
    """The resistance of a MOX sensor that meets gas at tick 0 and stays in it."""
    return [CLEAN_OHM * (lowest + (1.0 - lowest) * math.exp(-tick / 10.0 / rise_s)) for tick in range(ticks)]


def test_there_is_one_finding_in_each_span():
    found = findings(PID, [0.0] * 41, every_s=1.0)
    assert list(found) == [10, 20, 30, 40]
    assert not any(finding.is_hit for finding in found.values())


def test_a_whiff_within_a_span_makes_it_a_hit():
    values = [0.0] * 31
    values[14] = 0.3
    assert [finding.is_hit for finding in findings(PID, values, every_s=1.0).values()] == [False, True, False]


def test_below_the_threshold_there_is_no_gas():
    assert not any(finding.is_hit for finding in findings(PID, [0.2] * 21, threshold_ppm=0.25).values())
    assert all(finding.is_hit for finding in findings(PID, [0.3] * 21, threshold_ppm=0.25).values())


def test_a_mox_sensor_that_falls_has_hits_and_one_at_rest_in_clean_air_has_misses():
    falling = [CLEAN_OHM] * 40 + [CLEAN_OHM * math.exp(-0.05 * tick) for tick in range(1, 31)]
    found = findings(MOX, falling)
    assert [found[tick].is_hit for tick in (20, 30, 50, 60)] == [False, False, True, True]


def test_a_mox_sensor_that_recovers_says_nothing():
    found = findings(MOX, [CLEAN_OHM] * 40 + entering(400) + recovering(900))
    assert [tick for tick in found if 460 < tick < 680] == []
    assert not any(finding.is_hit for tick, finding in found.items() if tick > 460)
    assert not found[1300].is_hit


def test_a_mox_sensor_at_rest_in_gas_has_hits():
    """Steady gas is gas, as long as it stays; it was neither gas nor clean air once."""
    found = findings(MOX, [CLEAN_OHM] * 40 + entering(600))
    assert [found[tick].is_hit for tick in range(60, 640, 10)] == [True] * 58


@pytest.mark.parametrize("noise", [0.003, 0.02, 0.05])
def test_noise_takes_no_finding_from_clean_air_nor_from_steady_gas(noise):
    rng = np.random.default_rng(4)
    clean = [CLEAN_OHM * math.exp(noise * n) for n in rng.standard_normal(2400)]
    found = findings(MOX, clean)
    assert sum(not finding.is_hit for finding in found.values()) > 0.9 * 239
    gas = [0.4 * ohm for ohm in clean[:600]]
    found = findings(MOX, clean[:100] + gas)
    assert sum(finding.is_hit for tick, finding in found.items() if tick > 150) > 0.9 * 55


def test_a_baseline_that_drifts_is_no_gas():
    """Ten per cent in ten minutes, which is a level of 0.1 below the highest resistance that was seen."""
    found = findings(MOX, [CLEAN_OHM * math.exp(-0.15 * tick / 6000.0) for tick in range(6000)])
    assert not any(finding.is_hit for finding in found.values())


def test_a_mox_sensor_without_a_resistance_says_nothing():
    found = findings(MOX, [CLEAN_OHM] * 41 + [0.0] * 20)
    assert max(found) == 40


def test_a_sensor_that_warms_up_says_nothing():
    assert list(findings(PID, [5.0] * 41, warming=range(25))) == [30, 40]


def test_a_finding_of_a_lagging_sensor_belongs_to_where_the_vehicle_was():
    of_pid, of_mox = (findings(nose, [CLEAN_OHM] * 41, speed_m_s=1.0)[40] for nose in (PID, MOX))
    assert of_pid.sensor_m == pytest.approx((4.0, 5.0, 2.0))
    assert of_mox.sensor_m == pytest.approx((3.0, 5.0, 2.0))


def test_it_remembers_when_the_last_hit_was():
    evidence = GasEvidence(PID)
    assert evidence.since_hit_s(0.0) == math.inf
    evidence.add(observation(tick=10, readings={"nose": 1.0}))
    assert evidence.is_hit
    assert evidence.since_hit_s(3.0) == pytest.approx(2.0)
