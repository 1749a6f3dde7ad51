"""Declaration rules of each family of methods, and a guard against repeated declarations.

Held by:
    extensions/search/tests/unit/motion/test_declaration.py
    extensions/search/tests/unit/motion/test_posterior_rule.py
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gslcosim.agent_kit.commands import declaration
from gslcosim.contract.messages import Bounds, Briefing, Command, Observation
from gslcosim_search import beliefs, elementary
from gslcosim_search.beliefs import CellGrid
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.motion.legs import to_millimetre
from gslcosim_search.posterior.open_air import OpenAir
from gslcosim_search.posterior.source_posterior import SourcePosterior
from gslcosim_search.senses.hit_detection import GasHits, GasLevel
from gslcosim_search.senses.instruments import Nose, find_vanes

Point = tuple[float, ...]
Array = NDArray[np.float64]
# And a bit, for three stops exactly that far apart.
_THIRD_TURN_RAD = math.tau / 3.0 + 1e-6
# How close together the last stops are [m], and which share of the most gas counts as lost.
_TOGETHER_M, _LOST_SHARE = 1.5, 0.5
# Of missions that ask for a declaration: how far an estimate may move and count as the same [m], and the time from one
# reading to the next that counts [s].
_STILL_M, _PERIOD_S = 0.5, 1.0
# Share of the time limit after which a declaration is late.
LATE_SHARE = 0.9
# How many thresholds the greatest reading of a plume has, which share of it is strong, how far from it the upwind end
# may be, and how far from the end readings belong to it, in the plane [m].
PEAK_FACTOR, _STRONG_SHARE, _REACH_M, _NEAR_M = 5.0, 0.1, 4.0, 1.5
# From how far upwind of the end clean air counts [m], and how many readings of it are enough: three take as long as a
# PID needs to respond.
_EDGE_M, _N_CLEAN = 1.0, 3
# Of the posterior: how many readings with gas are enough, which advantage and which share within a metre are enough
# early [nat], the time constant of the mean of the wind [s], and how long before a reading its air was at the nose [s]:
# as long as a PID takes to respond.
_N_GAS, _LEAST_NATS, _LEAST_SHARE, _SMOOTH_S, _LAG_S = 10, 1.0, 0.8, 20.0, 1.5


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A place where the source may be, world frame [m], and how sure that is, from 0 to 1."""

    position_m: Point
    confidence: float


class DeclarationGuard:
    """Lets an estimate pass once: again only when it has moved, or when it is surer.

    State: the last estimate that passed.
    """

    def __init__(self, *, moved_m: float = 0.5, surer_by: float = 0.1) -> None:
        self.last: Estimate | None = None
        self._moved_m, self._surer_by = moved_m, surer_by

    def passes(self, estimate: Estimate | None) -> Estimate | None:
        """Return the estimate if it is to be declared now, and remember it; absent otherwise."""
        if estimate is None or not self._is_new(estimate):
            return None
        self.last = estimate
        return estimate

    def _is_new(self, estimate: Estimate) -> bool:
        if self.last is None or distance(estimate.position_m, self.last.position_m) > self._moved_m:
            return True
        return estimate.confidence >= self.last.confidence + self._surer_by


# What a reactive method remembers of a leg: where it ended and how much gas was there.
@dataclass(frozen=True, kw_only=True)
class _Stop:
    position_m: Point
    gas: float


class ReactiveRule:
    """Declares when the last legs stayed together in much gas whose upwind edge was crossed.

    1. the last `n_legs` stops lie within 1.5 m of their mean
    2. their mean gas is above 5 times `threshold`
    3. an upwind edge: there is a stop at least 1 m farther upwind than the stop with the most gas, and all such
       stops have less than half of that gas, or none (at most `threshold`)

    The estimate is the mean of the stops with gas (above `threshold`), weighted by it; its confidence is their share.
    Without a wind (`upwind_rad` absent) the gas must end all around: rule 3 then takes every stop that far away, and
    seen from the stop with the most gas they leave no third of a circle empty.

    State: the last stops.

    Source:
        Our rule; no reactive method of the literature but that of Li, Farrell et al. 2006 defines one. The edge is
        virtual: it is read off the stops, no leg is flown for it.
    """

    def __init__(
        self,
        *,
        threshold: float,
        n_legs: int = 12,
    ) -> None:
        """Begin without stops.

        Args:
            threshold: The least gas that counts, in the unit in which gas is added.
            n_legs: How many legs must agree, K.
        """
        self._threshold = threshold
        self._stops: deque[_Stop] = deque(maxlen=n_legs)

    def add(self, position_m: Sequence[float], gas: float) -> None:
        """Take note of a stop: its place (two or three coordinates) and what grows with the gas."""
        self._stops.append(_Stop(position_m=tuple(position_m), gas=gas))

    def estimate(self, upwind_rad: float | None) -> Estimate | None:
        """Return the estimate of the source, if all conditions hold now.

        Args:
            upwind_rad: The direction the wind comes from [rad]; absent in calm air.
        """
        stops = tuple(self._stops)
        if len(stops) < (self._stops.maxlen or 0) or not self._are_together(stops):
            return None
        if not sum(stop.gas for stop in stops) / len(stops) > PEAK_FACTOR * self._threshold:
            return None
        if not self._has_edge(stops, upwind_rad):
            return None
        with_gas = [stop for stop in stops if stop.gas > self._threshold]
        return Estimate(position_m=_centre(with_gas), confidence=len(with_gas) / len(stops))

    def _are_together(self, stops: Sequence[_Stop]) -> bool:
        n = len(stops)
        mean_m = [sum(column) / n for column in zip(*(stop.position_m for stop in stops))]
        return all(distance(stop.position_m, mean_m) <= _TOGETHER_M for stop in stops)

    def _has_edge(self, stops: Sequence[_Stop], upwind_rad: float | None) -> bool:
        best = max(stops, key=lambda stop: stop.gas)
        beyond = [stop for stop in stops if _ahead_m(best, stop, upwind_rad) >= _EDGE_M]
        lost = max(self._threshold, _LOST_SHARE * best.gas)
        if not beyond or any(stop.gas > lost for stop in beyond):
            return False
        return upwind_rad is not None or _widest_gap_rad(best, beyond) <= _THIRD_TURN_RAD


# A reading on the way, and the wind then.
@dataclass(frozen=True, kw_only=True)
class _Whiff(_Stop):
    upwind_rad: float | None


class PlumeEndRule:
    """Declares the upwind end of the gas that was met, with clean air upwind of it, or when time runs out.

    1. strong readings: at least 0.1 of the greatest one, at most 4 m from it, in a wind within 60 degrees of
       the one there
    2. the end: the strong reading farthest upwind; without a wind the greatest reading
    3. the estimate: the mean place of the strong readings within 1.5 m of the end, weighted by their gas
    4. clean air: of the readings in that wind from 1 m to 4 m upwind of the end and at most 1.5 m beside
       it, at least 3 are without gas, and more than half; or the bounds end before 1 m. Without a wind
       nothing is asked
    5. it is declared when the greatest reading is above 5 thresholds, and the estimate has stayed within
       0.5 m for `wait_s` with clean air upwind of it, or it is later than `latest_s`

    The confidence is the share of the strong readings' gas that lies within 1.5 m of the end, times the share of
    clean readings upwind of it: 0 where time runs out and nobody was there. Gas is met downwind of a source and not
    upwind of it, so the end is a better estimate than the greatest reading: where the source is higher or lower than
    the nose, the most gas is metres downwind. In air that turns in a room, gas goes on upwind of such an end.

    State: the readings, one a period, the greatest of them, and for how long the estimate has stayed.

    Source:
        The upwind end of what was detected as the source, noted where tracking upwind loses the plume, and a stop of
        its own for declaring: Li, Farrell, Pang, Arrieta 2006, doi:10.1109/TRO.2006.870627 (remembered, unverified).
        That declaration is a stage of its own after finding and tracking a plume: Macedo, Marques, Costa 2019,
        doi:10.3390/s19102231. How much clean air is asked for is ours.
    Deviation:
        One pass up the plume and out of it is enough, readings on the way count, and it is judged after a time: Li's
        rule (`reactive_searcher.LossPoints`) waits for losses of the plume that agree, and often for longer than a run.
    """

    def __init__(
        self,
        *,
        threshold: float,
        wait_s: float,
        latest_s: float,
        bounds: Bounds | None = None,
    ) -> None:
        """Begin without gas.

        Args:
            threshold: The least gas that counts, in the unit in which gas is added.
            wait_s: For how long the estimate must stay [s].
            latest_s: When it is declared even if it has not stayed [s].
            bounds: Of the room; absent: there are none near.
        """
        self._threshold, self._latest_s, self._bounds = threshold, latest_s, bounds
        self._unchanged = UnchangedRule(radius_m=_STILL_M, n_legs=1, for_s=wait_s)
        self._whiffs: list[_Whiff] = []
        self._clean: list[_Whiff] = []
        self._peak: _Whiff | None = None
        self._last_s = self._last_clean_s = -math.inf

    def add(self, time_s: float, position_m: Sequence[float], gas: float, upwind_rad: float | None) -> None:
        """Take note of a reading: its place, what grows with the gas, and where the wind comes from [rad]."""
        whiff = _Whiff(position_m=tuple(position_m), gas=gas, upwind_rad=upwind_rad)
        if gas <= self._threshold and time_s >= self._last_clean_s + _PERIOD_S:
            self._last_clean_s = time_s
            self._clean.append(whiff)
        if not (self._threshold < gas < math.inf) or time_s < self._last_s + _PERIOD_S:
            return
        self._last_s = time_s
        self._whiffs.append(whiff)
        if self._peak is None or gas > self._peak.gas:
            self._peak = whiff

    def estimate(self, time_s: float) -> Estimate | None:
        """Return the estimate of the source, if all conditions hold now."""
        if self._peak is None or not self._peak.gas > PEAK_FACTOR * self._threshold:
            return None
        strong = [whiff for whiff in self._whiffs if self._is_strong(whiff, self._peak)]
        end = self._find_end(strong, self._peak)
        found = self._estimate_at(end, strong)
        is_still = self._unchanged.add(found.position_m, time_s=time_s)
        is_clean, share = self._look_upwind(end, self._peak.upwind_rad)
        if not (is_still and is_clean) and time_s < self._latest_s:
            return None
        return replace(found, confidence=found.confidence * share)

    def _find_end(self, strong: Sequence[_Whiff], peak: _Whiff) -> _Whiff:
        if peak.upwind_rad is None:
            return peak
        return max(strong, key=lambda one: _ahead_m(peak, one, peak.upwind_rad))

    # Whether the air upwind of the end is clean, and which share of the readings there say so.
    def _look_upwind(self, end: _Whiff, upwind_rad: float | None) -> tuple[bool, float]:
        if upwind_rad is None:
            return True, 1.0
        n_clean, n_gas = (
            sum(self._is_upwind(one, end, upwind_rad) for one in readings) for readings in (self._clean, self._whiffs)
        )
        if not n_clean + n_gas and self._ends_before_edge(end, upwind_rad):
            return True, 1.0
        share = n_clean / max(1, n_clean + n_gas)
        return n_clean >= _N_CLEAN and share > 0.5, share

    def _is_upwind(self, one: _Whiff, end: _Whiff, upwind_rad: float) -> bool:
        ahead_m, beside_m = _ahead_m(end, one, upwind_rad), _ahead_m(end, one, upwind_rad + math.pi / 2.0)
        is_in_strip = _EDGE_M <= ahead_m <= _REACH_M and abs(beside_m) <= _NEAR_M
        return is_in_strip and _agree(one.upwind_rad, upwind_rad)

    def _ends_before_edge(self, end: _Whiff, upwind_rad: float) -> bool:
        if self._bounds is None:
            return False
        steps_m = (_EDGE_M * elementary.cos(upwind_rad), _EDGE_M * elementary.sin(upwind_rad))
        edge_m = [x + step for x, step in zip(end.position_m, steps_m)]
        return any(not low <= x <= high for low, x, high in zip(self._bounds.min_m, edge_m, self._bounds.max_m))

    def _estimate_at(self, end: _Whiff, strong: Sequence[_Whiff]) -> Estimate:
        near = [whiff for whiff in strong if distance(whiff.position_m[:2], end.position_m[:2]) <= _NEAR_M]
        confidence = sum(whiff.gas for whiff in near) / sum(whiff.gas for whiff in strong)
        return Estimate(position_m=_centre(near), confidence=min(1.0, confidence))

    def _is_strong(self, whiff: _Whiff, peak: _Whiff) -> bool:
        if whiff.gas < _STRONG_SHARE * peak.gas or not _agree(whiff.upwind_rad, peak.upwind_rad):
            return False
        return distance(whiff.position_m[:2], peak.position_m[:2]) <= _REACH_M


# Directions no more than 60 degrees apart; one that is not known agrees with all.
def _agree(upwind_rad: float | None, other_rad: float | None) -> bool:
    return upwind_rad is None or other_rad is None or elementary.cos(upwind_rad - other_rad) >= 0.5


class PosteriorRule:
    """Declares the most probable place of a source (`SourcePosterior`), where one place explains the readings.

    1. at least 10 readings with gas, one reading a period, and an advantage of the place above 0
    2. the advantage is at least 1 nat, the share within a metre at least 0.8, and the place has stayed
       within 0.5 m for `wait_s`; or it is later than `latest_s`

    The confidence is share (1 - exp(-advantage)): the probability of the place, times a trust in what follows from it.
    The wind is the running mean over 20 s; while there is none nothing is noted. The air of a reading was at the nose
    some time before, for a sensor takes as long to respond.

    State: the posterior, the running mean of the wind, the last places of the nose, for how long the estimate has
    stayed, and `explains`: whether a place explained the readings better than gas that may be met anywhere when the
    estimate was asked for.

    Source:
        The posterior's; when it is declared is ours, chosen on training flights of `open_2026_quick`.
    """

    def __init__(self, posterior: SourcePosterior, *, wait_s: float, latest_s: float) -> None:
        """Begin without readings.

        Args:
            posterior: New, without readings.
            wait_s: For how long the place must stay [s].
            latest_s: When it is declared even if it has not stayed [s].
        """
        self.posterior, self._latest_s = posterior, latest_s
        self._unchanged = UnchangedRule(radius_m=_STILL_M, n_legs=1, for_s=wait_s)
        self.explains = False
        self._wind_m_s = (0.0, 0.0)
        self._last_wind_s: float | None = None
        self._last_s = -math.inf
        # Time [s] and place [m], the oldest first.
        self._places: deque[tuple[float, Point]] = deque()

    def add(self, time_s: float, position_m: Sequence[float], level: float, wind_m_s: Sequence[float]) -> None:
        """Take note of a reading: its place, its level above clean air, and the wind there, world frame [m/s]."""
        u, v = self._wind_m_s
        share = 1.0 if self._last_wind_s is None else min(1.0, (time_s - self._last_wind_s) / _SMOOTH_S)
        self._wind_m_s = (u + share * (wind_m_s[0] - u), v + share * (wind_m_s[1] - v))
        self._last_wind_s = time_s
        self._places.append((time_s, tuple(position_m)))
        while len(self._places) > 1 and self._places[1][0] <= time_s - _LAG_S:
            self._places.popleft()
        if time_s < self._last_s + _PERIOD_S or not norm2(*self._wind_m_s) > 0.0:
            return
        self._last_s = time_s
        self.posterior.air.note_wind(time_s, self._wind_m_s)
        self.posterior.add(*self._places[0], level)

    def estimate(self, time_s: float) -> Estimate | None:
        """Return the estimate of the source, if all conditions hold now."""
        found = self.posterior.best()
        self.explains = found is not None and found.n_gas >= _N_GAS and found.advantage_nats > 0.0
        if found is None or not self.explains:
            return None
        is_still = self._unchanged.add(found.position_m[:2], time_s=time_s)
        is_sure = found.advantage_nats >= _LEAST_NATS and found.share >= _LEAST_SHARE
        if not (is_still and is_sure) and time_s < self._latest_s:
            return None
        confidence = found.share * -elementary.expm1(-found.advantage_nats)
        return Estimate(position_m=tuple(map(to_millimetre, found.position_m)), confidence=confidence)


class MissionDeclarer:
    """Gives the declaration of a method that follows a plume, where the mission asks for one.

    By `PosteriorRule` where a source at one place explains what was met, else by `PlumeEndRule`. The first waits for a
    tenth of the time limit without a change, the plume's end for a third of it; nine tenths of it are late for both. A
    MOX sensor that recovers shows gas of before: its readings are of gas while it has a hit, otherwise of clean air.

    State: that of the rules, the cleanest air, and the rule of the hits.
    """

    def __init__(
        self, briefing: Briefing, nose: Nose, *, plume_end: str = "by_mission", plume_fit: str = "never"
    ) -> None:
        """Begin without gas; `plume_end` and `plume_fit` say when each rule is applied: `by_mission`, or `never`."""
        self._nose, self._level, self._hits = nose, GasLevel(nose), GasHits(nose)
        self._end: PlumeEndRule | None = None
        self._posterior_rule: PosteriorRule | None = None
        self._vane = next(iter(find_vanes(briefing)), None)
        if briefing.task is None or not briefing.task.asks_for_declaration:
            return
        limit_s, threshold = briefing.time_limit_s, self._level.threshold
        if plume_end == "by_mission":
            self._end = PlumeEndRule(
                threshold=threshold, wait_s=limit_s / 3.0, latest_s=LATE_SHARE * limit_s, bounds=briefing.bounds
            )
        if plume_fit == "by_mission" and self._vane is not None:
            posterior = SourcePosterior(OpenAir(briefing.bounds), threshold=threshold)
            self._posterior_rule = PosteriorRule(posterior, wait_s=limit_s / 10.0, latest_s=LATE_SHARE * limit_s)

    @property
    def posterior(self) -> SourcePosterior | None:
        """The posterior over the places of the source; absent where `PosteriorRule` is not applied."""
        return None if self._posterior_rule is None else self._posterior_rule.posterior

    def add(self, observation: Observation, upwind_rad: float | None = None) -> None:
        """Take note of an observation, from `Agent.observe`; without a wind that is trusted there is no direction."""
        if (self._end is None and self._posterior_rule is None) or not self._nose.is_ready(observation):
            return
        value = self._nose.value(observation)
        level, is_hit = self._level.of(value), self._hits.add(observation)
        # A broken reading is no clean air.
        if not math.isfinite(value):
            return
        time_s, here_m, level = observation.time_s, observation.position_world_m, level if is_hit else 0.0
        if self._end is not None:
            self._end.add(time_s, here_m, level, upwind_rad)
        if self._posterior_rule is not None and self._vane is not None and self._vane.is_ready(observation):
            wind_m_s = self._vane.wind_world_m_s(observation)
            if all(map(math.isfinite, (*wind_m_s, level))):
                self._posterior_rule.add(time_s, here_m, level, wind_m_s)

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source, if it is to be declared now."""
        time_s = observation.time_s
        if self._posterior_rule is not None:
            found = self._posterior_rule.estimate(time_s)
            if found is not None or self._posterior_rule.explains:
                return found
        return None if self._end is None else self._end.estimate(time_s)


class ReactiveDeclarer:
    """Gives the declarations of a reactive method with one nose: by `ReactiveRule`, and where the mission asks for one.

    State: the rule's stops, the cleanest air that was met, and what was declared.
    """

    def __init__(
        self,
        nose: Nose,
        *,
        height_m: float,
        is_on: bool = True,
        apart_m: float = 0.1,
        mission_declarer: MissionDeclarer | None = None,
    ) -> None:
        """Begin with nothing declared.

        Args:
            height_m: Where the source is said to be, for a method in the plane [m].
            apart_m: Questions no farther apart than this are asked at one stop [m].
            mission_declarer: The rules for missions that ask for a declaration; absent: none.
        """
        self._mission_declarer = mission_declarer
        self._apart_m = apart_m
        self._level, self._height_m, self._is_on = GasLevel(nose), height_m, is_on
        self._rule = ReactiveRule(threshold=self._level.threshold)
        self._declared = DeclarationGuard()
        self._stop_m: Point | None = None

    def observe(self, observation: Observation) -> None:
        """Take note of gas on the way, from `Agent.observe`; these methods know no wind."""
        if self._mission_declarer is not None:
            self._mission_declarer.add(observation)

    def command(
        self, observation: Observation, value: float | None, *, upwind_rad: float | None = None, is_planar: bool = True
    ) -> Command | None:
        """Take note of a stop; return the declaration that answers the question, if there is one.

        Args:
            value: The reading of this stop, in the nose's unit; absent while the sensor warms up.
            upwind_rad: The direction the wind comes from [rad]; absent without a vane or in calm air.
            is_planar: Whether the method searches at one height.
        """
        if value is None or not self._is_on:
            return None
        stop_m = observation.position_world_m[: 2 if is_planar else 3]
        level = self._level.of(value)
        # After a declaration the vehicle is asked again where it is.
        if self._stop_m is None or distance(stop_m, self._stop_m) > self._apart_m:
            self._stop_m = stop_m
            self._rule.add(stop_m, level)
        found = self._rule.estimate(upwind_rad)
        if found is None and self._mission_declarer is not None:
            found = self._mission_declarer.estimate(observation)
        estimate = self._declared.passes(found)
        if estimate is None:
            return None
        place_m = (*estimate.position_m, self._height_m)[:3]
        return declaration(observation, place_m, estimate.confidence)


class UnchangedRule:
    """Declares a peak that has stayed where it is: of a map, a gradient, or a swarm's best.

    State: where the peak was when it moved last, and for how many legs and since when it has been there.

    Source:
        10 legs within 0.5 m for peaks of gas maps, ours; 60 s for a swarm's best, remembered, unverified [M].
    """

    def __init__(self, *, radius_m: float = 0.5, n_legs: int = 10, for_s: float = 0.0) -> None:
        """Begin without a peak: it must stay within `radius_m` for `n_legs` additions and for `for_s`."""
        self._radius_m, self._n_legs, self._for_s = radius_m, n_legs, for_s
        self._place_m: Point | None = None
        self._n_same, self._since_s = 0, 0.0

    def add(self, peak_m: Sequence[float], *, time_s: float = 0.0) -> bool:
        """Take note of a peak; return whether it has been unchanged for long enough."""
        if self._place_m is None or distance(peak_m, self._place_m) > self._radius_m:
            self._place_m, self._n_same, self._since_s = tuple(peak_m), 0, time_s
        self._n_same += 1
        return self._n_same >= self._n_legs and time_s - self._since_s >= self._for_s


class SwarmRule:
    """Declares a swarm's best place when all members are near it for a time, or when it is the best for long.

    State: since when all are near, and the rule about an unchanged best.

    Source:
        20 s within 1.5 m and 60 s unchanged: remembered, unverified [M].
    """

    def __init__(self, *, radius_m: float = 1.5, near_s: float = 20.0, unchanged_s: float = 60.0) -> None:
        self._radius_m, self._near_s = radius_m, near_s
        self._near_since_s: float | None = None
        self._unchanged = UnchangedRule(radius_m=0.0, n_legs=1, for_s=unchanged_s)

    def add(self, time_s: float, best_m: Sequence[float], members_m: Sequence[Sequence[float]]) -> Estimate | None:
        """Take note of the best place and of where the members are; return the estimate if the rule holds.

        Its confidence is the share of members that are near.
        """
        n_near = sum(distance(best_m, member_m) <= self._radius_m for member_m in members_m)
        if n_near < len(members_m) or not members_m:
            self._near_since_s = None
        elif self._near_since_s is None:
            self._near_since_s = time_s
        is_unchanged = self._unchanged.add(best_m, time_s=time_s)
        are_near = self._near_since_s is not None and time_s - self._near_since_s >= self._near_s
        if not (are_near or is_unchanged):
            return None
        return Estimate(position_m=tuple(best_m), confidence=n_near / max(1, len(members_m)))


def by_variance(p: Array, grid: CellGrid, *, limit_m2: float = 0.5, radius_m: float = 1.0) -> Estimate | None:
    """Return the mean of the best cells when a belief has drawn together: var x + var y < limit.

    The confidence is the probability within `radius_m` of it.

    Source:
        GrGSL and PMFS: 0.5 m^2 by default, 1.0 and 1.5 in their launch files [C]; the estimate over the best 5 %, [C].
    """
    return _estimate_of(p, grid, radius_m) if beliefs.variance_m2(p, grid) < limit_m2 else None


def by_mass(p: Array, grid: CellGrid, *, radius_m: float = 1.0, least: float = 0.9) -> Estimate | None:
    """Return the mean place inside the best ball when that holds enough of a belief; confidence is what it holds."""
    centre_m, mass = beliefs.best_ball(p, grid, radius_m)
    if not mass > least:
        return None
    inside = np.where(beliefs.distances_m(grid, centre_m) <= radius_m, p, 0.0)
    return Estimate(position_m=beliefs.mean_m(beliefs.normalised(inside), grid), confidence=mass)


def by_entropy(p: Array, grid: CellGrid, *, limit_bits: float = 1.0, radius_m: float = 1.0) -> Estimate | None:
    """Return the mean of the best cells when a belief's entropy is below a limit [bit]; confidence as `by_variance`."""
    return _estimate_of(p, grid, radius_m) if beliefs.entropy_bits(p) < limit_bits else None


def by_spread(positions_m: Array, weights: Array, *, limit_m: float = 0.5, radius_m: float = 1.0) -> Estimate | None:
    """Return the mean of weighted particles when they have drawn together: sqrt(sum of variances) < limit.

    The confidence is the weight within `radius_m` of it.

    Args:
        positions_m: (n_particles, d) places, world frame [m].
        weights: (n_particles,) none negative; need not sum to 1.
        limit_m: 0.4 m in AutoSTE, 0.5 m in the MAPIR group's particle filter [C].
    """
    share = beliefs.normalised(weights)
    mean_m = elementary.product(share, positions_m)
    squares_m2 = np.square(positions_m - mean_m).sum(axis=1)
    if not math.sqrt(float((share * squares_m2).sum())) < limit_m:
        return None
    near = float(share[squares_m2 <= radius_m * radius_m].sum())
    return Estimate(position_m=tuple(float(x) for x in mean_m), confidence=min(1.0, near))


def _estimate_of(p: Array, grid: CellGrid, radius_m: float) -> Estimate:
    position_m = beliefs.mean_of_best_m(p, grid)
    return Estimate(position_m=position_m, confidence=min(1.0, beliefs.mass_within(p, grid, position_m, radius_m)))


# The widest angle between neighbouring stops, seen from another one.
def _widest_gap_rad(origin: _Stop, stops: Sequence[_Stop]) -> float:
    x_m, y_m = origin.position_m[:2]
    bearings_rad = sorted(elementary.atan2(stop.position_m[1] - y_m, stop.position_m[0] - x_m) for stop in stops)
    return max(b - a for a, b in pairwise([*bearings_rad, bearings_rad[0] + math.tau]))


# How far a stop lies upwind of another; without a wind, how far away.
def _ahead_m(origin: _Stop, stop: _Stop, upwind_rad: float | None) -> float:
    dx_m, dy_m = stop.position_m[0] - origin.position_m[0], stop.position_m[1] - origin.position_m[1]
    if upwind_rad is None:
        return norm2(dx_m, dy_m)
    return dx_m * elementary.cos(upwind_rad) + dy_m * elementary.sin(upwind_rad)


def _centre(stops: Sequence[_Stop]) -> Point:
    total = sum(stop.gas for stop in stops)
    return tuple(
        sum(stop.gas * x for stop, x in zip(stops, column)) / total
        for column in zip(*(stop.position_m for stop in stops))
    )
