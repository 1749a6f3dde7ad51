"""Legs: where they may end, the planner from a goal to a leg that the vehicle can do, and detection of being stuck.

Where the wind turns in a circle, "upwind" leads a reactive search round the eddy for ever. The stuck detector notices.

Held by:
    extensions/search/tests/unit/motion/test_legs.py
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from gslcosim.agent_kit.commands import waypoint
from gslcosim.contract.messages import Bounds, Briefing, Command, Observation
from gslcosim_search import elementary
from gslcosim_search.elementary import distance, norm2
from gslcosim_search.occupancy import OccupancyMap
from gslcosim_search.random_stream import RandomStream

Point = tuple[float, ...]
N_TRIES = 100
# Ends closer together than this are the same, to a vehicle that refused one of them.
_SAME_END_M = 0.02
_BACK_OFF_M = 0.1
# By how much and how often a refused leg is made shorter.
_SHORTEN_M, _N_SHORTEN = 0.05, 10
# To the left and the right of the way that is blocked, ever farther [rad]: 45 and 90 degrees.
_EIGHTH_TURN_RAD = 0.7853981633974483
# A cut leg shorter than this is not worth to be flown.
_LEAST_LEG_M = 0.1


def to_millimetre(length_m: float) -> float:
    """Return a length rounded to whole millimetres, half up, so that the last bit of sin and cos has no effect."""
    return math.floor(length_m * 1000.0 + 0.5) / 1000.0


@dataclass(frozen=True, kw_only=True)
class LegSpace:
    """Space in which legs may end: from `min_m` to `max_m`, and outside the obstacles, if any are known."""

    min_m: Point
    max_m: Point
    obstacles: OccupancyMap | None = None

    @classmethod
    def within(cls, bounds: Bounds, margin_m: float, *, obstacles: OccupancyMap | None = None) -> "LegSpace":
        """Return the room that keeps a margin to the bounds; where there is less than two margins, its middle."""
        middles = [(low + high) / 2.0 for low, high in zip(bounds.min_m, bounds.max_m)]
        return cls(
            min_m=tuple(min(low + margin_m, middle) for low, middle in zip(bounds.min_m, middles)),
            max_m=tuple(max(high - margin_m, middle) for high, middle in zip(bounds.max_m, middles)),
            obstacles=obstacles,
        )

    @classmethod
    def of(cls, briefing: Briefing, margin_m: float, *, is_planar: bool = True) -> "LegSpace":
        """Return the room of a briefing with a margin, and with the obstacles of its map, if one was granted.

        A planar method sees a map with three axes at its search height.
        """
        known_map, height_m = briefing.known_map, briefing.search_height_m if is_planar else None
        obstacles = None if known_map is None else OccupancyMap.of(known_map, height_m=height_m)
        return cls.within(briefing.bounds, margin_m, obstacles=obstacles)

    def contains(self, point_m: Sequence[float]) -> bool:
        """Return True if a point with two or three coordinates is inside, whatever the obstacles."""
        return all(low <= x <= high for x, low, high in zip(point_m, self.min_m, self.max_m))

    def is_free(self, start_m: Sequence[float], end_m: Sequence[float]) -> bool:
        """Return True if a leg may go straight to an end."""
        return self.contains(end_m) and (self.obstacles is None or self.obstacles.is_free_line(start_m, end_m))

    def farthest(self, start_m: Sequence[float], heading_rad: float, length_m: float) -> Point:
        """Return the farthest end of a straight leg along a heading, in whole millimetres, x and y [m].

        It ends at the margin, or 0.1 to 0.2 m short of what is solid.
        From outside the margin it is the nearest place inside.
        """
        if not self.contains(start_m[:2]):
            return self.nearest(start_m[:2])
        direction = (elementary.cos(heading_rad), elementary.sin(heading_rad))
        for x, step, low, high in zip(start_m, direction, self.min_m, self.max_m):
            side = high if step > 0.0 else low
            length_m = min(length_m, (side - x) / step) if step != 0.0 else length_m
        if self.obstacles is not None:
            length_m = self._free_length_m(start_m, direction, length_m, self.obstacles)
        return tuple(to_millimetre(x + length_m * step) for x, step in zip(start_m, direction))

    # In steps: the longest that is free, and one step less where something ended it.
    def _free_length_m(
        self, start_m: Sequence[float], direction: tuple[float, float], length_m: float, obstacles: OccupancyMap
    ) -> float:
        for i in range(math.ceil(length_m / _BACK_OFF_M)):
            shorter_m = length_m - _BACK_OFF_M * i
            if obstacles.is_free_line(start_m[:2], [x + shorter_m * step for x, step in zip(start_m, direction)]):
                return shorter_m if i == 0 else max(0.0, shorter_m - _BACK_OFF_M)
        return 0.0

    def nearest(self, point_m: Sequence[float]) -> Point:
        """Return the point inside that is nearest, in whole millimetres, with as many coordinates."""
        clamped = (max(low, min(high, x)) for x, low, high in zip(point_m, self.min_m, self.max_m))
        return tuple(to_millimetre(x) for x in clamped)


@dataclass(frozen=True, kw_only=True)
class Leg:
    """A leg that may be flown: its end, in whole millimetres, and its heading; without one it only leads inside."""

    end_m: Point
    heading_rad: float | None


def leg_end(
    start_m: Sequence[float], heading_rad: float, length_m: float, room: LegSpace, *, climb_m: float | None = None
) -> Point | None:
    """Return the end of a straight leg, in whole millimetres; absent where the leg may not be flown.

    end = start + length (cos heading, sin heading), and z + climb where a climb is given

    Args:
        start_m: Where it begins, x, y and what follows, world frame [m].
        heading_rad: Counter-clockwise from +x [rad].
        climb_m: How much higher it ends [m]; absent: the end has x and y only.
    """
    dimensions = 2 if climb_m is None else 3
    steps_m = (length_m * elementary.cos(heading_rad), length_m * elementary.sin(heading_rad), climb_m or 0.0)
    end_m = tuple(to_millimetre(x + step) for x, step in zip(start_m[:dimensions], steps_m))
    return end_m if room.is_free(start_m[:dimensions], end_m) else None


def shorten_leg(
    start_m: Sequence[float],
    heading_rad: float,
    length_m: float,
    room: LegSpace,
    *,
    by_m: float = 0.05,
    n_tries: int = 10,
) -> Point | None:
    """Return the end of the longest leg that may be flown, made shorter step by step; absent where none may.

    Source:
        The MAPIR group's surge-cast: steps of 0.05 m, 10 tries [C].
    """
    for i in range(n_tries + 1):
        shorter_m = length_m - i * by_m
        if shorter_m <= 0.0:
            return None
        end_m = leg_end(start_m, heading_rad, shorter_m, room)
        if end_m is not None:
            return end_m
    return None


def random_headings(draws: RandomStream, n_tries: int = N_TRIES) -> Iterator[float]:
    """Yield headings drawn one by one, as they are asked for, uniform in [0, 2 pi) [rad]."""
    for _ in range(n_tries):
        yield draws.angle_rad()


def find_free_heading(
    start_m: Sequence[float],
    headings_rad: Iterable[float],
    length_m: float,
    room: LegSpace,
    *,
    refused_m: Sequence[float] | None = None,
) -> float | None:
    """Return the first heading along which a leg may be flown; absent where none may.

    Args:
        start_m: Where the leg begins, world frame [m].
        headings_rad: What to try, in this order [rad].
        length_m: The leg's length [m].
        refused_m: An end that was refused: a leg to the same place is not tried again.
    """
    for heading_rad in headings_rad:
        end_m = leg_end(start_m, heading_rad, length_m, room)
        if end_m is not None and not _is_same(end_m, refused_m):
            return heading_rad
    return None


def next_leg(
    start_m: Sequence[float],
    headings_rad: Iterable[float],
    length_m: float,
    room: LegSpace,
    draws: RandomStream,
    *,
    refused_m: Sequence[float] | None = None,
) -> Leg:
    """Return a leg in any case: along the first heading that is free, else along a random one, else back inside.

    Numbers are drawn only for headings that are tried. The arguments are those of `find_free_heading`.
    """
    tried = find_free_heading(start_m, headings_rad, length_m, room, refused_m=refused_m)
    heading_rad = (
        tried
        if tried is not None
        else find_free_heading(start_m, random_headings(draws), length_m, room, refused_m=refused_m)
    )
    if heading_rad is None:
        return Leg(end_m=room.nearest(start_m[:2]), heading_rad=None)
    end_m = leg_end(start_m, heading_rad, length_m, room)
    assert end_m is not None
    return Leg(end_m=end_m, heading_rad=heading_rad)


def _is_same(end_m: Point, refused_m: Sequence[float] | None) -> bool:
    return refused_m is not None and distance(end_m, refused_m[: len(end_m)]) < _SAME_END_M


class LegPlanner:
    """Flies legs to places, and never a refused leg again as it was.

    1. A leg ends where it meets the margin of the room (with a granted map also before what is solid, in steps of
       0.05 m, at most 10 of them).
    2. Where that leaves nothing, or is the leg that was refused, ways at 45 and 90 degrees to either side are tried,
       then random ones.
    3. Where nothing fits it goes to the nearest place inside the margin.

    State: where the last leg was to end, and until when the vehicle is busy with it.
    """

    def __init__(self, briefing: Briefing, draws: RandomStream, *, margin_m: float) -> None:
        """Begin without a leg; a map is used where the briefing grants one."""
        self.room = LegSpace.of(briefing, margin_m)
        self.height_m = briefing.search_height_m
        self._draws = draws
        self._hold_s = briefing.hold_s
        self._tick_s = briefing.tick_ns / 1e9
        self._is_asked_always = briefing.mode != "on_request"
        self._deaf_ticks = briefing.latency_ticks if self._is_asked_always else 0
        self._end_m: tuple[float, ...] | None = None
        self._leg_hold_s = 0.0
        self._commanded_tick: int | None = None
        self._rest_since_tick: int | None = None

    def was_refused(self, observation: Observation) -> bool:
        """Return True if the vehicle's notice says that it did not do as it was asked."""
        return observation.notice is not None and self._end_m is not None

    def is_busy(self, observation: Observation) -> bool:
        """Return True if the last leg, with its hold, is not over yet.

        A vehicle that is asked when it holds never is. One that is asked at every tick is on its way until it has been
        at rest for the hold; commands that it has not received yet count as on their way.
        """
        if not self._is_asked_always or self._commanded_tick is None or observation.notice is not None:
            return False
        if observation.tick <= self._commanded_tick + self._deaf_ticks or observation.status != "holding":
            self._rest_since_tick = None
            return True
        if self._rest_since_tick is None:
            self._rest_since_tick = observation.tick
        return (observation.tick - self._rest_since_tick) * self._tick_s < self._leg_hold_s - 1e-9

    def continue_leg(self, observation: Observation) -> Command | None:
        """Return the command that changes nothing while the last leg is not over, None after it."""
        return self.stay(observation) if self.is_busy(observation) else None

    def stay(self, observation: Observation) -> Command:
        """Return the command that changes nothing."""
        return Command(tick=observation.tick, kind="noop")

    def is_worth_it(self, observation: Observation, target_m: Sequence[float]) -> bool:
        """Return True if a leg towards a place leads anywhere before it meets the margin of the room."""
        start_m = observation.position_world_m
        level_m = distance(start_m[:2], cut_end_m(start_m, target_m, self.room))
        climb_m = self._height_within(target_m[2]) - start_m[2] if len(target_m) > 2 else 0.0
        return norm2(level_m, climb_m) >= _LEAST_LEG_M

    def leg(
        self,
        observation: Observation,
        target_m: Sequence[float],
        *,
        z_m: float | None = None,
        hold_s: float | None = None,
    ) -> Command:
        """Return the command for a leg to a place, or as near to it as can be flown.

        Args:
            target_m: Where to go, world frame [m]; a third coordinate is left out.
            z_m: At which height [m]; absent: the search height.
            hold_s: How long to hold there [s]; absent: the briefing's time.
        """
        start_m = observation.position_world_m[:2]
        refused_m = self._end_m if self.was_refused(observation) else None
        z_m = self.height_m if z_m is None else self._height_within(z_m)
        x_m, y_m = self._end(start_m, target_m, refused_m)
        self._end_m = (x_m, y_m)
        self._leg_hold_s = self._hold_s if hold_s is None else hold_s
        self._commanded_tick, self._rest_since_tick = observation.tick, None
        return waypoint(observation, x_m, y_m, z_m, hold_s=hold_s)

    def _height_within(self, z_m: float) -> float:
        return to_millimetre(max(self.room.min_m[2], min(self.room.max_m[2], z_m)))

    def _end(
        self, start_m: Sequence[float], target_m: Sequence[float], refused_m: Sequence[float] | None
    ) -> tuple[float, float]:
        wanted_m = distance(start_m, target_m[:2])
        if wanted_m < _SAME_END_M and refused_m is None:
            return to_millimetre(start_m[0]), to_millimetre(start_m[1])
        aim_m = cut_end_m(start_m, target_m, self.room)
        dx_m, dy_m = aim_m[0] - start_m[0], aim_m[1] - start_m[1]
        length_m, heading_rad = norm2(dx_m, dy_m), elementary.atan2(dy_m, dx_m)
        end_m = shorten_leg(start_m, heading_rad, length_m, self.room, by_m=_SHORTEN_M, n_tries=_N_SHORTEN)
        if end_m is None or (refused_m is not None and distance(end_m, refused_m) < _SAME_END_M):
            towards_rad = elementary.atan2(target_m[1] - start_m[1], target_m[0] - start_m[0])
            end_m = next_leg(start_m, _around(towards_rad), wanted_m, self.room, self._draws, refused_m=refused_m).end_m
        return end_m[0], end_m[1]


def cut_end_m(start_m: Sequence[float], target_m: Sequence[float], room: LegSpace) -> tuple[float, float]:
    """Return the last place on the straight way to a target that lies inside a room's margin, world frame [m].

    t = min over x, y of (side - start) / (target - start), within [0, 1];  end = start + t (target - start)

    From a start outside the margin it is the nearest place to the target inside.
    """
    t = 1.0
    for start, target, low, high in zip(start_m[:2], target_m[:2], room.min_m, room.max_m):
        if not low <= start <= high:
            x_m, y_m = room.nearest(target_m[:2])
            return x_m, y_m
        if target > high:
            t = min(t, (high - start) / (target - start))
        elif target < low:
            t = min(t, (low - start) / (target - start))
    return start_m[0] + t * (target_m[0] - start_m[0]), start_m[1] + t * (target_m[1] - start_m[1])


def step_towards_m(start_m: Sequence[float], target_m: Sequence[float], step_m: float) -> tuple[float, float]:
    """Return the place a step nearer to a target, or the target where that is nearer [m]."""
    distance_m = distance(start_m[:2], target_m[:2])
    part = 1.0 if distance_m <= step_m else step_m / distance_m
    return start_m[0] + part * (target_m[0] - start_m[0]), start_m[1] + part * (target_m[1] - start_m[1])


def _around(heading_rad: float) -> Iterator[float]:
    for turn_rad in (_EIGHTH_TURN_RAD, 2.0 * _EIGHTH_TURN_RAD):
        yield heading_rad + turn_rad
        yield heading_rad - turn_rad


class StuckDetector:
    """The places of the last legs; it is wound up when all of them lie close together.

    wound up: n places noted, and |p_k - mean(p)| <= R for each of the last n        n legs, R radius [m]

    Source:
        Ours, against a known fault of searches that follow the wind.
    """

    def __init__(self, *, n_legs: int, radius_m: float) -> None:
        """Begin without places.

        Args:
            n_legs: How many legs must end close together; 0 switches it off.
            radius_m: How close to their mean [m].
        """
        self._places_m: deque[tuple[float, float]] = deque(maxlen=max(n_legs, 1))
        self._n_legs = n_legs
        self._radius_m = radius_m

    def note(self, place_m: Sequence[float]) -> None:
        """Take note of where a leg has ended, world frame [m]; a height is left out."""
        self._places_m.append((float(place_m[0]), float(place_m[1])))

    @property
    def is_stuck(self) -> bool:
        """True if the last legs have led nowhere."""
        if self._n_legs == 0 or len(self._places_m) < self._n_legs:
            return False
        x_m = math.fsum(x for x, _ in self._places_m) / self._n_legs
        y_m = math.fsum(y for _, y in self._places_m) / self._n_legs
        return all(norm2(x - x_m, y - y_m) <= self._radius_m for x, y in self._places_m)

    def release(self) -> None:
        """Forget all places: the vehicle leaves, or stays for a reason."""
        self._places_m.clear()
