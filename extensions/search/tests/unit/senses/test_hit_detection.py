import math

import briefings
import numpy as np
import pytest
from briefings import observation

from gslcosim.contract.messages import Observation
from gslcosim_search.senses.hit_detection import (
    BoutDetector,
    GasEvidence,
    GasHits,
    GasLevel,
    OnsetDetector,
    RunningRange,
    is_more_gas,
)
from gslcosim_search.senses.instruments import Nose

STEP_S = 0.1
PID = Nose(name="nose", unit="ppm", mount_body_m=(0.0, 0.0, 0.0))
MOX = Nose(name="nose", unit="ohm", mount_body_m=(0.0, 0.0, 0.0))
CLEAN_OHM, DECAY_S = 50_000.0, 18.75


def shown(tick: int, value: float, *, is_warming_up=False) -> Observation:
    warming = ["nose"] if is_warming_up else ()
    return briefings.observation(
        tick=tick, time_s=tick * STEP_S, readings={"nose": value}, warming=warming, asked=False
    )


def nose(unit: str) -> Nose:
    return Nose(name="nose", unit=unit, mount_body_m=(0.0, 0.0, 0.0))


def fed(detector, values, *, step_s=STEP_S):
    """What a detector says to each of a series of values."""
    return [detector.add(i * step_s, value) for i, value in enumerate(values)]


@pytest.mark.parametrize("ohm", [50_000.0, 49_760.0, 49_740.0, 40_000.0, 60_000.0])
@pytest.mark.parametrize("eps", [0.0, 0.005])
def test_more_gas_by_conductance_is_the_rule_for_resistances(ohm, eps):
    assert is_more_gas(1 / ohm, 1 / 50_000.0, eps=eps) == (ohm < 50_000.0 * (1 - eps))


def test_below_the_floor_nothing_is_more_gas():
    assert is_more_gas(0.3, 0.0)
    assert not is_more_gas(0.3, 0.0, floor=0.3)


def test_a_running_range_scales_to_what_was_seen():
    seen = RunningRange()
    assert seen.fraction(3.0) == 0.0
    for value in (2.0, 4.0, math.inf, math.nan):
        seen.add(value)
    assert [seen.fraction(value) for value in (1.0, 2.0, 3.0, 4.0, 9.0)] == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_the_level_of_a_mox_sensor_is_above_the_cleanest_air_it_has_met():
    level = GasLevel(nose("ohm"))
    assert [level.of(ohm) for ohm in (4e4, 5e4, 2.5e4, 5e4)] == pytest.approx([0.0, 0.0, 1.0, 0.0])
    assert level.of(0.0) == pytest.approx(999.0)
    assert GasLevel(nose("ohm")).of(0.0) == 0.0


@pytest.mark.parametrize("step_s", [0.02, 0.1, 0.5])
def test_the_slope_of_an_exponential_is_its_rate_whatever_the_step(step_s):
    detector = OnsetDetector(smoothing_s=1.0)
    fed(detector, 5e4 * np.exp(-0.07 * np.arange(0.0, 20.0, step_s)), step_s=step_s)
    assert detector.slope_per_s == pytest.approx(-0.07, rel=1e-6)
    assert detector.is_onset
    assert not detector.is_offset


def test_the_onset_detector_distinguishes_gas_that_comes_from_gas_that_goes():
    """A first-order sensor: 10 s of clean air, 8 s of gas, 20 s of clean air."""
    target = np.repeat([1.0, 0.4, 1.0], [100, 80, 200])
    ratio, ratios = 1.0, []
    for goal in target:
        ratio += (1 - math.exp(-STEP_S / (4.8 if goal < ratio else 18.75))) * (goal - ratio)
        ratios.append(ratio)
    detector = OnsetDetector()
    onsets, offsets = [], []
    for i, value in enumerate(ratios):
        onsets.append(detector.add(i * STEP_S, 5e4 * value))
        offsets.append(detector.is_offset)
    assert not any(onsets[:100]) and not any(offsets[:100])  # noqa: PT018
    assert all(onsets[105:175])
    assert not any(onsets[190:])
    assert all(offsets[200:300])


@pytest.mark.parametrize("n_repeats", [1, 3])
def test_the_noise_that_is_learnt_is_that_of_the_slope(n_repeats):
    """Also where a slow sensor repeats its values, within the approximation of the formula for that case."""
    rng = np.random.default_rng(3)
    ohms = np.repeat(5e4 * np.exp(0.01 * rng.standard_normal(4000)), n_repeats)
    detector, slopes, thresholds = OnsetDetector(k=1.0, least_slope_per_s=0.0), [], []
    for i, ohm in enumerate(ohms):
        detector.add(i * STEP_S, ohm)
        slopes.append(detector.slope_per_s)
        thresholds.append(detector.threshold_per_s)
    assert np.mean(thresholds[500:]) == pytest.approx(np.std(slopes[500:]), rel=0.1 * n_repeats)


def test_a_first_sample_in_gas_is_no_onset_and_broken_samples_change_nothing():
    detector = OnsetDetector(learn_s=0.0)
    assert not detector.add(0.0, 100.0)
    for ohm in (0.0, -1.0, math.nan, math.inf):
        assert not detector.add(1.0, ohm)
    assert not detector.add(0.0, 10.0)  # no time has gone by
    assert detector.slope_per_s == 0.0


def test_a_bout_is_what_three_averages_by_hand_say():
    """With a sample a `sample_s` the weights are 2 / (n + 1) for 3, 8 and 5 samples."""
    amounts = [0.0, 1.0, 3.0, 2.0, 0.0, 0.0, 1.0]
    detector = BoutDetector(sample_s=0.5, least_rise=-math.inf)
    fast = slow = amounts[0]
    signal, expected = 0.0, [False]
    for amount in amounts[1:]:
        fast, slow = fast + (amount - fast) / 2, slow + (amount - slow) * 2 / 9
        signal += (fast - slow - signal) / 3
        expected.append(fast - slow > signal)
    assert fed(detector, amounts, step_s=0.5) == expected
    assert detector.rise == pytest.approx(fast - slow)
    assert detector.signal == pytest.approx(signal)


def test_recovery_is_a_bout_by_the_published_rule_only():
    pulse = [0.0] * 5 + [5.0] * 10 + [0.0] * 40
    published, ours = BoutDetector(least_rise=-math.inf), BoutDetector()
    after = slice(20, None)
    assert any(fed(published, pulse, step_s=1.0)[after])
    said = fed(ours, pulse, step_s=1.0)
    assert not any(said[after])
    assert said[5]


@pytest.mark.parametrize(("unit", "clean", "gas"), [("ppm", 0.05, 0.2), ("1", 0.0, 1.0)])
def test_hits_of_a_direct_sensor_are_above_a_threshold(unit, clean, gas):
    hits = GasHits(nose(unit))
    assert [hits.add(shown(i, value)) for i, value in enumerate([clean, gas, clean])] == [False, True, False]
    assert hits.take()
    assert not hits.take()
    assert hits.since_hit_s(1.1) == pytest.approx(1.0)


def test_hits_of_a_mox_sensor_are_onsets():
    hits = GasHits(nose("ohm"))
    ohms = [5e4] * 100 + [5e4 * math.exp(-0.05 * i * STEP_S) for i in range(100)]
    said = [hits.add(shown(i, ohm)) for i, ohm in enumerate(ohms)]
    assert not any(said[:100])
    assert all(said[110:])


def test_a_sensor_that_warms_up_and_a_tick_sent_twice_give_no_hit():
    hits = GasHits(nose("ppm"))
    assert hits.since_hit_s(5.0) == math.inf
    assert not hits.add(shown(1, 9.0, is_warming_up=True))
    assert hits.add(shown(2, 9.0))
    assert hits.take()
    assert hits.add(shown(2, 9.0))
    assert not hits.take()


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
