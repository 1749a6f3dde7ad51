"""Reactive agents: contact with the plume at each stop, legs, exploration, stuck detection and declaration.

Held by:
    extensions/search/tests/unit/reactive/test_reactive_searcher.py
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import SimpleNamespace

from gslcosim.agent_kit import Briefing, Command, Observation
from gslcosim.base.quantities import Vec3
from gslcosim_search import elementary
from gslcosim_search.elementary import distance
from gslcosim_search.motion.coverage import CoverageGrid
from gslcosim_search.motion.declaration import Estimate, MissionDeclarer, ReactiveRule
from gslcosim_search.motion.exploration import exploration_leg_end_m
from gslcosim_search.motion.legs import LegPlanner, StuckDetector
from gslcosim_search.search_agent import SearchAgent, extract_settings
from gslcosim_search.senses.instruments import find_noses
from gslcosim_search.senses.stop_and_measure import Contact, PlumeContactDetector


class LossPoints:
    """The places farthest up the wind at which gas was met last before it was lost.

    u(p) = (p - o) . (cos w, sin w)        along the wind, w where it comes from; o any place
    declares: n places, and max u - min u < spread over the n of greatest u; the source is at their greatest u

    A search that goes up a plume loses it here and there, and always just behind its source: there the places farthest
    up the wind lie close together. The confidence is the share of them within `spread_m` of the estimate in the plane.

    State: the n places. The wind of the moment sorts them.

    Source:
        Li, Farrell, Pang, Arrieta 2006, doi:10.1109/TRO.2006.870627: six places, 4 m at sea (remembered, unverified).
    Deviation:
        The spread is scaled to rooms.
    """

    def __init__(self, *, n: int, spread_m: float) -> None:
        """Begin without places.

        Args:
            n: How many places must agree.
            spread_m: Within which length along the wind [m].
        """
        self._n = n
        self._spread_m = spread_m
        self.places_m: list[Vec3] = []

    def add(self, place_m: Vec3, upwind_rad: float) -> None:
        """Take note of the last place with gas before it was lost, world frame [m]; the farthest downwind goes."""
        self.places_m.append(place_m)
        self.places_m.sort(key=lambda place: -_along_m(place, upwind_rad))
        del self.places_m[self._n :]

    def estimate(self, upwind_rad: float) -> Estimate | None:
        """Return the estimate of the source, once the recorded positions are close together."""
        if len(self.places_m) < self._n:
            return None
        ordered = sorted(self.places_m, key=lambda place: -_along_m(place, upwind_rad))
        if _along_m(ordered[0], upwind_rad) - _along_m(ordered[-1], upwind_rad) >= self._spread_m:
            return None
        n_near = sum(distance(place[:2], ordered[0][:2]) <= self._spread_m for place in ordered)
        return Estimate(position_m=ordered[0], confidence=n_near / self._n)


def _along_m(place_m: Sequence[float], upwind_rad: float) -> float:
    return place_m[0] * elementary.cos(upwind_rad) + place_m[1] * elementary.sin(upwind_rad)


@dataclass(frozen=True, kw_only=True)
class ReactiveSettings:
    """Settings that every reactive method has; its card gives their values and where they come from.

    `margin_m` is kept to the walls; `hold_s` is held after a leg (absent: the briefing's) and `explore_hold_s` after
    one that only explores or casts; `explore_step_m` is the edge of the squares of `coverage.CoverageGrid`;
    `threshold_ppm` and `threshold_m_s` are the least gas and wind that count; `leash_legs` legs within `leash_m` are
    too many, after which `leash_away_legs` legs only explore; `declares` switches declarations, by
    `declaration.ReactiveRule`, and after `n_lost` losses of the plume within `spread_m` by `LossPoints`. Where the
    mission asks for a declaration, `plume_fit` and `plume_end` say whether `declaration.MissionDeclarer` declares.
    """

    margin_m: float
    hold_s: float | None
    explore_hold_s: float
    explore_step_m: float
    threshold_ppm: float
    threshold_m_s: float
    leash_legs: int
    leash_m: float
    leash_away_legs: int
    declares: bool
    n_lost: int = 6
    spread_m: float = 1.0
    plume_fit: str = "by_mission"
    plume_end: str = "by_mission"


class ReactiveAgent(SearchAgent):
    """An agent that answers gas and wind of the moment: a subclass says which step follows from a contact.

    Gas may end a leg that is under way (`may_abort`). It declares by `declaration.ReactiveRule`, by `LossPoints` where
    the method says that it has lost the plume, and by `declaration.MissionDeclarer` where the mission asks for a
    declaration. A stuck search is sent away to explore for some legs.

    Its settings: those of `ReactiveSettings`.

    State: that of its parts, the contact of the last stop, and for how many more legs the search is sent away.
    """

    def __init__(self, briefing: Briefing, settings: SimpleNamespace | None = None) -> None:
        super().__init__(briefing, settings)
        shared = self.shared = extract_settings(ReactiveSettings, self.settings)
        self.pilot = LegPlanner(briefing, self.draws, margin_m=shared.margin_m)
        self.watch = PlumeContactDetector(
            briefing, threshold_ppm=shared.threshold_ppm, threshold_m_s=shared.threshold_m_s
        )
        self.unseen = CoverageGrid(self.pilot.room, edge_m=shared.explore_step_m)
        self._contact: Contact | None = None
        self._stuck_detector = StuckDetector(n_legs=shared.leash_legs, radius_m=shared.leash_m)
        self._rule = ReactiveRule(threshold=shared.threshold_ppm)
        self._losses = LossPoints(n=shared.n_lost, spread_m=shared.spread_m)
        self._declarer = MissionDeclarer(
            briefing, find_noses(briefing)[0], plume_end=shared.plume_end, plume_fit=shared.plume_fit
        )
        self.explore_height_m: float | None = None
        self._n_away = 0
        self._goal_m: tuple[float, float] | None = None

    def observe(self, observation: Observation) -> None:
        """Watch for gas on the way too."""
        self.watch.add(observation)
        self.unseen.note(observation.position_world_m)
        self._declarer.add(observation, None if self._contact is None else self._contact.upwind_rad)

    @property
    def may_abort(self) -> bool:
        """True if gas ends a leg that is under way; only a vehicle that is asked meanwhile can do so."""
        return False

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command while a leg is under way that gas does not end."""
        command = self.pilot.continue_leg(observation)
        return None if self.may_abort and self.watch.is_hit and not self.is_away else command

    def learn(self, observation: Observation) -> None:
        """Take note of the contact at this stop, and of whether the last legs have led anywhere."""
        contact = self._contact = self.watch.contact(observation)
        self._rule.add(observation.position_world_m, contact.gas_ppm)
        self._stuck_detector.note(observation.position_world_m)
        if self._stuck_detector.is_stuck:
            self._stuck_detector.release()
            self._n_away = self.shared.leash_away_legs

    def estimate(self, observation: Observation) -> Estimate | None:
        """Return the estimate of the source, if the last stops or the readings of the whole search satisfy a rule."""
        assert self._contact is not None
        return self._rule.estimate(self._contact.upwind_rad) or self._declarer.estimate(observation)

    def next_leg(self, observation: Observation) -> Command:
        """Return the step that follows from the contact."""
        assert self._contact is not None
        return self.next_step(observation, self._contact)

    @abstractmethod
    def next_step(self, observation: Observation, contact: Contact) -> Command:
        """Return the command for the next leg, given the contact with the plume."""

    def lose(self, observation: Observation, contact: Contact, upwind_rad: float) -> Command | None:
        """Take note that the plume was lost; return the declaration, if these losses tell where the source is.

        Where a posterior declares, losses do not: false findings of a MOX sensor make some too, anywhere.

        Args:
            contact: What is known at it; where gas was met last counts.
            upwind_rad: The wind against which the plume was followed [rad].
        """
        if contact.last_m is None:
            return None
        self._losses.add(contact.last_m, upwind_rad)
        is_asked = self.shared.declares and self._declarer.posterior is None
        found = self._losses.estimate(upwind_rad) if is_asked else None
        return None if found is None else self.declare(observation, found)

    @property
    def is_away(self) -> bool:
        """True if the method got stuck and is to explore, whatever it smells."""
        return self._n_away > 0

    def fly_to(self, observation: Observation, target_m: tuple[float, ...], *, hold_s: float | None = None) -> Command:
        """Return the command for a leg to a place, with the hold of the settings where none is given."""
        self._goal_m = None
        z_m = target_m[2] if len(target_m) > 2 else None
        return self.pilot.leg(observation, target_m, z_m=z_m, hold_s=self.shared.hold_s if hold_s is None else hold_s)

    def cast_to(self, observation: Observation, target_m: tuple[float, ...]) -> Command:
        """Return the command for a leg on which only the way matters: it ends with the shorter hold."""
        return self.fly_to(observation, target_m, hold_s=self.shared.explore_hold_s)

    def follow(self, observation: Observation, next_place_m: Callable[[], tuple[float, ...] | None]) -> Command | None:
        """Return the command for a leg to the next place of a cast or a loop, or nothing when that is over.

        Places behind a wall, to which no leg leads, are left out; a refused one is not tried again.

        Args:
            next_place_m: Gives the next place, world frame [m], or nothing.
        """
        while (place_m := next_place_m()) is not None:
            if self.pilot.is_worth_it(observation, place_m):
                return self.cast_to(observation, place_m)
        return None

    def explore(self, observation: Observation) -> Command:
        """Return the command for a leg to where a reading would tell the most of the source, or to what was not seen.

        The first where the mission asks for a declaration by the posterior and the way is free, else the nearest place
        that was not seen; a refused one counts as seen. The leg is at `explore_height_m`, absent: at the search height.
        """
        self._n_away = max(0, self._n_away - 1)
        was_refused = self._goal_m is not None and self.pilot.was_refused(observation)
        if self._goal_m is not None and was_refused:
            self.unseen.skip(self._goal_m)
        upwind_rad = None if self._contact is None else self._contact.upwind_rad
        z_m = self.explore_height_m
        goal_m = None if was_refused else self._informative_place_m(observation)
        goal_m = goal_m or self.unseen.next_place_m(observation.position_world_m, upwind_rad)
        command = self.cast_to(observation, goal_m if z_m is None else (*goal_m, z_m))
        self._goal_m = goal_m
        return command

    def _informative_place_m(self, observation: Observation) -> tuple[float, float] | None:
        posterior = self._declarer.posterior
        if posterior is None:
            return None
        here_m = observation.position_world_m
        place_m = exploration_leg_end_m(posterior, observation.time_s, here_m, self.pilot.room)
        return place_m if place_m is not None and self.pilot.is_worth_it(observation, place_m) else None
