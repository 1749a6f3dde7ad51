"""Hit detection: gas or no gas from a sensor that lags, drifts and is noisy, as evidence for and against.

Held by:
    extensions/search/tests/unit/senses/test_hit_detection.py
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import Observation
from gslcosim_search import elementary
from gslcosim_search.senses.instruments import Nose

# A reading may jump between two observations that a silent second separates; steps of time are bounded below.
_LEAST_STEP_S = 1e-9
# Time constants of a MOX sensor's level and slow slope, and with which its baseline follows a lower resistance [s].
_LEVEL_SMOOTHING_S, _FORGET_S = 3.0, 300.0
# A MOX sensor below this part of its resistance in clean air says no more than that there is very much gas.
_LEAST_RATIO = 1e-3
# A MOX sensor's onset is smoothed over about this long: the gas was met where the vehicle was then.
MOX_LAG_S = 1.0
# Spans are whole ticks: a share of a tick decides nothing.
_ROUNDING_S = 1e-6


def is_more_gas(amount: float, before: float, *, eps: float = 0.005, floor: float = 0.0) -> bool:
    """Return True if there is more gas than before, by more than a dead band.

    (1 - eps) c > max(c_before, floor)      c amount, in any unit that grows with the gas
    For a resistance, c = 1 / R, this is R < (1 - eps) R_before. `eps` 0 is a strict comparison.

    Args:
        amount: The reading now, as `Nose.amount` gives it.
        eps: Dead band, fraction of the reading.
        floor: What clean air shows at most; below it nothing counts as more.

    Source:
        GSL-Bench compares strictly (eps 0, floor 0). The dead band is ours: with noise a strict comparison in clean
        air is a coin flip.
    """
    return (1.0 - eps) * amount > max(before, floor)


class RunningRange:
    """Remembers the least and the most that was ever seen, and scales a value to [0, 1] between them.

    State: least and most. Without a difference between them every value is 0.
    """

    def __init__(self) -> None:
        self.least = math.inf
        self.most = -math.inf

    def add(self, value: float) -> None:
        """Take note of a value; infinities are ignored."""
        if math.isfinite(value):
            self.least = min(self.least, value)
            self.most = max(self.most, value)

    def fraction(self, value: float) -> float:
        """Return the position of the value between minimum and maximum, in [0, 1]."""
        if not self.most > self.least:
            return 0.0
        return min(1.0, max(0.0, (value - self.least) / (self.most - self.least)))


class GasLevel:
    """Level of a nose above clean air, whatever its unit, with a threshold to compare it with.

    ohm: c = R_clean / R - 1        R_clean the most that was ever shown, a MOX sensor in the cleanest air it has met
    ppm, hits, detections: c as it is

    State: R_clean.
    """

    def __init__(self, nose: Nose) -> None:
        """Begin without having seen clean air: the first reading is level 0."""
        self.nose = nose
        self._clean_ohm = 0.0

    @property
    def threshold(self) -> float:
        """The least level that counts as gas: 0.1 ppm, hits or detections; 0.04 for ohms.

        A TGS2600 has the level 0.18 in 0.5 ppm of ethanol, about five thresholds, as it is for the others.
        """
        return 0.04 if self.nose.unit == "ohm" else 0.1

    def of(self, value: float) -> float:
        """Return the level of a reading, in the sensor's unit, and remember the cleanest air."""
        if self.nose.unit != "ohm":
            return value
        self._clean_ohm = max(self._clean_ohm, value)
        return self._clean_ohm / max(value, _LEAST_RATIO * self._clean_ohm) - 1.0 if self._clean_ohm > 0.0 else 0.0


class OnsetDetector:
    """Finds from the slope of ln R when a MOX sensor meets gas, and when it leaves it.

    s' = (ln R - s) / tau        smoothed logarithm s; its slope s' is the smoothed d(ln R)/dt [1/s]
    onset:  s' < -max(k sd, least_slope)        sd of the slope that noise alone makes [1/s]
    offset: s' > +max(k sd, least_slope)
    sd = w q sqrt(2 / (2 - w)) / dt        q sd of white noise in ln R, w = 1 - exp(-dt / tau) weight of a sample
    q^2 = mean of (change of ln R - s' dt)^2 / 2        over the samples that differ from the one before

    A resistance that falls as exp(-a t) settles to the slope -a. A constant one has slope 0, however high: the
    detector does not know R0. A MOX sensor lags by seconds and recovers over tens of seconds; its slope changes sign
    at once when gas comes or goes, while its level does not.

    State: s, s', q^2, the last sample and its time. New when made.

    Source:
        Onsets in place of thresholds are common for MOX sensors. sd of the slope: our derivation, the variance of a
        white sequence minus its exponential average.
    """

    def __init__(
        self,
        *,
        k: float = 3.0,
        smoothing_s: float = 1.0,
        least_slope_per_s: float = 0.005,
        memory_s: float = 20.0,
        learn_s: float = 2.0,
    ) -> None:
        """Begin in clean air.

        Args:
            k: How many standard deviations of noise make an onset.
            smoothing_s: Time constant tau of the smoothing [s].
            least_slope_per_s: The least slope that counts, whatever the noise [1/s].
            memory_s: Over how long the noise is remembered [s].
            learn_s: For how long from the first sample nothing counts [s].
        """
        self.slope_per_s = 0.0
        self.threshold_per_s = least_slope_per_s
        self._k, self._smoothing_s, self._least_per_s = k, smoothing_s, least_slope_per_s
        self._memory_s, self._learn_s = memory_s, learn_s
        self._smooth: float | None = None
        self._last_log = 0.0
        self._noise_variance = 0.0
        self._n_changes = 0
        self._first_s = self._last_s = 0.0

    @property
    def log_ohm(self) -> float | None:
        """The smoothed logarithm of the resistance; none before the first sample."""
        return self._smooth

    @property
    def is_onset(self) -> bool:
        """True if the resistance is falling: the gas grows."""
        return not self._is_learning and bool(self.slope_per_s < -self.threshold_per_s)

    @property
    def is_offset(self) -> bool:
        """True if the resistance is rising: the sensor recovers from gas."""
        return not self._is_learning and bool(self.slope_per_s > self.threshold_per_s)

    @property
    def _is_learning(self) -> bool:
        return self._last_s - self._first_s < self._learn_s

    def add(self, time_s: float, ohm: float) -> bool:
        """Take a sample; return whether the gas grows. Samples of no later time and broken ones are ignored."""
        if not (math.isfinite(ohm) and ohm > 0.0):
            return self.is_onset
        log_ohm = elementary.log(ohm)
        if self._smooth is None:
            self._smooth = self._last_log = log_ohm
            self._first_s = self._last_s = time_s
        elif time_s - self._last_s > _LEAST_STEP_S:
            self._follow(log_ohm, self._smooth, time_s - self._last_s)
            self._last_s, self._last_log = time_s, log_ohm
        return self.is_onset

    # The slope is the mean one of the smoothed logarithm over the step, so that steps may differ in length.
    def _follow(self, log_ohm: float, smooth: float, step_s: float) -> None:
        weight = -elementary.expm1(-step_s / self._smoothing_s)
        self._learn_noise(
            log_ohm - self._last_log - self.slope_per_s * step_s, step_s, is_new=log_ohm != self._last_log
        )
        self._smooth = smooth + weight * (log_ohm - smooth)
        self.slope_per_s = weight * (log_ohm - smooth) / step_s
        sd_per_s = weight * math.sqrt(self._noise_variance * 2.0 / (2.0 - weight)) / step_s
        self.threshold_per_s = max(self._k * sd_per_s, self._least_per_s)

    # A sensor slower than the observations repeats its values, which says nothing of its noise.
    def _learn_noise(self, surprise: float, step_s: float, *, is_new: bool) -> None:
        if not is_new:
            return
        self._n_changes += 1
        weight = max(-elementary.expm1(-step_s / self._memory_s), 1.0 / self._n_changes)
        self._noise_variance += weight * (surprise * surprise / 2.0 - self._noise_variance)


class MoxEvidence:
    """Tells gas, clean air and recovery apart by a MOX sensor's level and derivative.

    level L = b - s             s ln R smoothed over 3 s, b baseline: the ln R of clean air
    gas that grows: onset, see `OnsetDetector`
    gas that stays: L > `level` and s' <= slope threshold of the slow smoothing
    recovery:       L > `level` and s' above it: what the sensor shows is gas of before
    clean air:      L <= `level` and no onset

    The baseline runs with the sensor: b = s where s is above it, else it follows s with the time constant 300 s,
    so that it neither keeps one lucky reading for ever nor takes a drift for gas. In gas that stays for longer than
    about that time it is lost: 0.9 of level, 5 ppm at a TGS2600, is forgotten after 11 minutes.
    The first sample is taken for clean air.

    State: a fast and a slow `OnsetDetector`, b.

    Source:
        Level above a running baseline and derivative together, as bouts are found in MOX signals (Schmuker, Bahr and
        Huerta 2016, Sensors and Actuators B 235, 636, who smooth, differentiate and ask for a least amplitude).
    Deviation:
        Theirs are bouts alone; gas that stays and air that is clean are told here too.
    """

    def __init__(self, *, level: float = 0.1) -> None:
        """Begin in clean air; `level` is the fall of ln R below the baseline that counts as gas shown."""
        self._onset = OnsetDetector()
        # A TGS2600 that recovers rises by more than this as long as its level is above 0.06.
        self._slow = OnsetDetector(smoothing_s=_LEVEL_SMOOTHING_S, least_slope_per_s=0.003)
        self._level = level
        self._baseline: float | None = None
        self._last_s = 0.0
        self._is_broken = False

    @property
    def level(self) -> float:
        """Distance of ln R below the baseline; 0 in clean air."""
        smooth = self._slow.log_ohm
        return 0.0 if smooth is None or self._baseline is None else self._baseline - smooth

    @property
    def is_gas(self) -> bool:
        """True if gas grows or stays."""
        return self._onset.is_onset or (self.level > self._level and not self._slow.is_offset)

    @property
    def is_recovering(self) -> bool:
        """True if the sensor still shows gas of before, or nothing that can be read."""
        return self._is_broken or (self.level > self._level and self._slow.is_offset and not self._onset.is_onset)

    def add(self, time_s: float, ohm: float) -> bool:
        """Take a sample; return whether there is gas. A broken sample says nothing."""
        self._is_broken = not (math.isfinite(ohm) and ohm > 0.0)
        self._onset.add(time_s, ohm)
        self._slow.add(time_s, ohm)
        smooth = self._slow.log_ohm
        if smooth is not None:
            before = smooth if self._baseline is None else self._baseline
            self._baseline = smooth + max(0.0, before - smooth) * elementary.exp(-(time_s - self._last_s) / _FORGET_S)
        self._last_s = time_s
        return self.is_gas and not self._is_broken


class BoutDetector:
    """Distinguishes bouts of growing gas from slow changes, for any sensor, by three moving averages.

    D = E3(c) - E8(c)        En exponential moving average of n samples, weight 2 / (n + 1)
    S = E5(D)
    bout: D > S and D > least_rise

    The averages are scaled to time: n samples of `sample_s` each, whatever the spacing of what is added; a sample after
    dt has the weight 1 - (1 - 2 / (n + 1))^(dt / sample_s). About a fifth of a sensor's lag suits `sample_s`.

    State: the three averages and the last time. New when made.

    Source:
        Chasing Ghosts, arXiv 2602.19577, in its public code [C]; there D > S alone.
    Deviation:
        D must also exceed `least_rise`: while a sensor recovers D returns to 0 from below and S lags behind it, which
        D > S alone takes for gas. `least_rise` -inf is the published rule.
    """

    SPANS = (3.0, 8.0, 5.0)

    def __init__(self, *, sample_s: float = 1.0, least_rise: float = 0.0) -> None:
        """Begin without gas; `sample_s` is the time that one sample of the spans stands for [s]."""
        self.rise = 0.0
        self.signal = 0.0
        self._sample_s, self._least_rise = sample_s, least_rise
        self._fast = self._slow = 0.0
        self._last_s: float | None = None

    @property
    def is_bout(self) -> bool:
        """True if the gas grows now."""
        return self.rise > self.signal and self.rise > self._least_rise

    def add(self, time_s: float, amount: float) -> bool:
        """Take a sample of what grows with the gas; return whether there is a bout. Broken samples are ignored."""
        if not math.isfinite(amount):
            return self.is_bout
        if self._last_s is None:
            self._last_s, self._fast, self._slow = time_s, amount, amount
        elif time_s - self._last_s > _LEAST_STEP_S:
            fast, slow, signal = (self._weight(span, time_s - self._last_s) for span in self.SPANS)
            self._last_s = time_s
            self._fast += fast * (amount - self._fast)
            self._slow += slow * (amount - self._slow)
            self.rise = self._fast - self._slow
            self.signal += signal * (self.rise - self.signal)
        return self.is_bout

    def _weight(self, span: float, step_s: float) -> float:
        return 1.0 - elementary.pow(1.0 - 2.0 / (span + 1.0), step_s / self._sample_s)


class GasHits:
    """Hits of one nose, by the rule that suits its unit: call `add` with every observation.

    A sensor that answers in ohms has a hit while the gas grows or stays (`MoxEvidence`), one in ppm while it shows more
    than `threshold_ppm`, one of detections or hits while it shows more than half a hit. None while it warms up.

    State: the detector, the last tick, the time of the last hit, and whether there was a hit since `take` was called.
    """

    def __init__(self, nose: Nose, *, threshold_ppm: float = 0.1, mox: MoxEvidence | None = None) -> None:
        """Begin without a hit; `mox` is used for ohms only."""
        self.nose = nose
        self.is_hit = False
        self.last_hit_s: float | None = None
        self._is_untaken = False
        self._last_tick: int | None = None
        self._rule = _rule_of(nose, threshold_ppm, mox or MoxEvidence())

    def add(self, observation: Observation) -> bool:
        """Take note of an observation; return whether there is a hit at it. A tick counts once."""
        if observation.tick == self._last_tick:
            return self.is_hit
        self._last_tick = observation.tick
        self.is_hit = self.nose.is_ready(observation) and self._rule(observation)
        if self.is_hit:
            self._is_untaken, self.last_hit_s = True, observation.time_s
        return self.is_hit

    def take(self) -> bool:
        """Return True if there was a hit since the last call, and forget it."""
        was_hit, self._is_untaken = self._is_untaken, False
        return was_hit

    def since_hit_s(self, time_s: float) -> float:
        """Return the time since the last hit [s], infinite without one."""
        return math.inf if self.last_hit_s is None else time_s - self.last_hit_s


def _rule_of(nose: Nose, threshold_ppm: float, mox: MoxEvidence) -> Callable[[Observation], bool]:
    if nose.unit == "ohm":
        return lambda observation: mox.add(observation.time_s, nose.value(observation))
    threshold = threshold_ppm if nose.unit == "ppm" else 0.5
    return lambda observation: nose.amount(observation) > threshold


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Gas was detected in a span of time, or the air was clean all through it; at `sensor_m`, world frame [m]."""

    is_hit: bool
    sensor_m: Vec3


class GasEvidence:
    """Turns the readings of one nose into findings, one for each `every_s`: call `add` with every observation.

    hit: there was one by the rule of `GasHits` within the span
    clean: there was none, and the sensor could have told: a MOX sensor that recovers still shows gas of before, and is
    no evidence for clean air (`MoxEvidence`)
    Otherwise, and while the sensor warms up, there is no finding.

    State: the rule of the hits, the last second's places, and what was found in this span so far.

    Source:
        Ours: a MOX sensor that lags knows a third state between gas and none.
    """

    def __init__(self, nose: Nose, *, every_s: float = 1.0, threshold_ppm: float = 0.1, level: float = 0.1) -> None:
        """Begin without findings.

        Args:
            every_s: How long a span is [s]; findings closer together are hardly independent.
            threshold_ppm: What counts as gas, for sensors in ppm.
            level: Fall of ln R that counts as gas shown, for sensors in ohms.
        """
        self.nose = nose
        self._mox = MoxEvidence(level=level)
        self._hits = GasHits(nose, threshold_ppm=threshold_ppm, mox=self._mox)
        self._every_s = every_s
        self._lag_s = MOX_LAG_S if nose.unit == "ohm" else 0.0
        self._track: deque[tuple[float, Vec3]] = deque()
        self._span_ends_s: float | None = None
        self._is_unclear = False
        self._last_tick: int | None = None

    @property
    def is_hit(self) -> bool:
        """True if there is a hit at the last observation."""
        return self._hits.is_hit

    def since_hit_s(self, time_s: float) -> float:
        """Return the time since the last hit [s], infinite without one."""
        return self._hits.since_hit_s(time_s)

    def add(self, observation: Observation) -> Finding | None:
        """Take note of an observation; return the finding of the span that ends with it, if there is one."""
        if observation.tick == self._last_tick:
            return None
        self._last_tick = observation.tick
        self._follow(observation)
        self._hits.add(observation)
        self._is_unclear |= not self.nose.is_ready(observation) or (self.nose.unit == "ohm" and self._mox.is_recovering)
        if self._span_ends_s is None:
            self._span_ends_s = observation.time_s + self._every_s
        if observation.time_s < self._span_ends_s - _ROUNDING_S:
            return None
        self._span_ends_s = observation.time_s + self._every_s
        was_hit, was_unclear = self._hits.take(), self._is_unclear
        self._is_unclear = False
        return Finding(is_hit=was_hit, sensor_m=self._track[0][1]) if was_hit or not was_unclear else None

    # Keeps where the vehicle was as long ago as the sensor lags.
    def _follow(self, observation: Observation) -> None:
        self._track.append((observation.time_s, observation.position_world_m))
        while len(self._track) > 1 and self._track[1][0] <= observation.time_s - self._lag_s + _ROUNDING_S:
            self._track.popleft()
