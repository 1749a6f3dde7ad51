"""Leg planner: from a goal to a leg that the vehicle can do, cut at walls, shortened, or led around."""

import math
from collections.abc import Iterator, Sequence

from gslcosim.contract.messages import Briefing, Command, Observation
from gslcosim.search.motion.commands import waypoint
from gslcosim.search.motion.legs import LegSpace, build_obstacles, next_leg, shorten_leg, to_millimetre
from gslcosim.search.random_stream import RandomStream

# To the left and the right of the way that is blocked, ever farther [rad]: 45 and 90 degrees.
_EIGHTH_TURN_RAD = 0.7853981633974483
_SAME_END_M = 0.02
# A cut leg shorter than this is not worth to be flown.
_LEAST_LEG_M = 0.1


class LegPlanner:
    """Flies legs to places, and never a refused leg again as it was.

    1. A leg ends where it meets the margin of the room (with a granted map also before what is solid, in steps of
       `shorten_m`, at most `n_shorten` of them).
    2. Where that leaves nothing, or is the leg that was refused, ways at 45 and 90 degrees to either side are tried,
       then random ones.
    3. Where nothing fits it goes to the nearest place inside the margin.

    State: where the last leg was to end, and until when the vehicle is busy with it.

    Held by:
        tests/unit/search/motion/test_leg_planner.py
    """

    def __init__(
        self, briefing: Briefing, draws: RandomStream, *, margin_m: float, shorten_m: float = 0.05, n_shorten: int = 10
    ) -> None:
        """Begin without a leg; a map is used where the briefing grants one."""
        obstacles = (
            None
            if briefing.known_map is None
            else build_obstacles(briefing.known_map, height_m=briefing.search_height_m)
        )
        self.room = LegSpace.within(briefing.bounds, margin_m, obstacles=obstacles)
        self.height_m = briefing.search_height_m
        self._draws = draws
        self._shorten_m, self._n_shorten = shorten_m, n_shorten
        self._hold_s = briefing.hold_s
        self._tick_s = briefing.tick_ns / 1e9
        self._is_asked_always = briefing.mode != "on_request"
        self._deaf_ticks = briefing.latency_ticks if self._is_asked_always else 0
        self._end_m: tuple[float, ...] | None = None
        self._leg_hold_s = 0.0
        self._commanded_tick: int | None = None
        self._rest_since_tick: int | None = None

    def was_refused(self, observation: Observation) -> bool:
        """Return whether the vehicle's notice says that it did not do as it was asked."""
        return observation.notice is not None and self._end_m is not None

    def is_busy(self, observation: Observation) -> bool:
        """Return whether the last leg, with its hold, is not over yet.

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

    def stay(self, observation: Observation) -> Command:
        """Return the command that changes nothing."""
        return Command(tick=observation.tick, kind="noop")

    def is_worth_it(self, observation: Observation, target_m: Sequence[float]) -> bool:
        """Return whether a leg towards a place leads anywhere before it meets the margin of the room."""
        start_m = observation.position_world_m
        level_m = math.dist(start_m[:2], cut_end_m(start_m, target_m, self.room))
        climb_m = self._height_within(target_m[2]) - start_m[2] if len(target_m) > 2 else 0.0
        return math.hypot(level_m, climb_m) >= _LEAST_LEG_M

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
            observation: The question.
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
        wanted_m = math.dist(start_m, target_m[:2])
        if wanted_m < _SAME_END_M and refused_m is None:
            return to_millimetre(start_m[0]), to_millimetre(start_m[1])
        aim_m = cut_end_m(start_m, target_m, self.room)
        dx_m, dy_m = aim_m[0] - start_m[0], aim_m[1] - start_m[1]
        length_m, heading_rad = math.hypot(dx_m, dy_m), math.atan2(dy_m, dx_m)
        end_m = shorten_leg(start_m, heading_rad, length_m, self.room, by_m=self._shorten_m, n_tries=self._n_shorten)
        if end_m is None or (refused_m is not None and math.dist(end_m, refused_m) < _SAME_END_M):
            towards_rad = math.atan2(target_m[1] - start_m[1], target_m[0] - start_m[0])
            end_m = next_leg(start_m, _around(towards_rad), wanted_m, self.room, self._draws, refused_m=refused_m).end_m
        return end_m[0], end_m[1]


def cut_end_m(start_m: Sequence[float], target_m: Sequence[float], room: LegSpace) -> tuple[float, float]:
    """Return the last place on the straight way to a target that lies inside a room's margin, world frame [m].

    t = min over x, y of (side - start) / (target - start), within [0, 1];  end = start + t (target - start)

    From a start outside the margin it is the nearest place to the target inside.

    Held by:
        tests/unit/search/motion/test_leg_planner.py
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
    distance_m = math.dist(start_m[:2], target_m[:2])
    part = 1.0 if distance_m <= step_m else step_m / distance_m
    return start_m[0] + part * (target_m[0] - start_m[0]), start_m[1] + part * (target_m[1] - start_m[1])


def _around(heading_rad: float) -> Iterator[float]:
    for turn_rad in (_EIGHTH_TURN_RAD, 2.0 * _EIGHTH_TURN_RAD):
        yield heading_rad + turn_rad
        yield heading_rad - turn_rad
