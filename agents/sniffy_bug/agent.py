"""Sniffy Bug: waypoints by particle swarm, flown with four range finders along lines, walls and past each other.

After Duisterhof et al. README.md beside this file has the rules.
"""

import numpy as np

from gslcosim.agent_kit import Briefing, Command, Observation, run
from gslcosim_search.elementary import distance
from gslcosim_search.motion.legs import LegSpace
from gslcosim_search.swarms.particle_swarm import Sighting, limit_length
from gslcosim_search.swarms.sniffy_bug import (
    TABLES,
    Bug,
    find_four_ranges,
    remove_blocked_parts,
    searching_waypoint,
    tracking_waypoint,
)
from gslcosim_search.swarms.swarm_robot import SwarmMember, Vector

# How fast it goes back to its height: so much per metre, at most so fast.
CLIMB_PER_S = 1.0
CLIMB_M_S = 0.3


class SniffyBug(SwarmMember):
    """One bug: a waypoint, the way there, and what the swarm knows."""

    program = __file__

    def __init__(self, briefing: Briefing) -> None:
        super().__init__(briefing)
        self.ranges = find_four_ranges(briefing)
        self.table = TABLES[self.settings.table]
        self.bug = Bug(self.table, past_m=self.settings.past_m)
        self.room = LegSpace.within(briefing.bounds, self.settings.wall_margin_m)
        self.waypoint_m: Vector | None = None
        self.since_s = 0.0
        self.followed: Sighting | None = None

    def next_leg(self, observation: Observation) -> Command:
        """Return the velocity until the next question."""
        self.update_waypoint(is_blocked=observation.notice is not None)
        direction = self.direction(observation)
        x_m_s, y_m_s = self.settings.speed_m_s * direction
        climb_m_s = CLIMB_PER_S * (self.height_m - observation.position_world_m[2])
        return Command(
            tick=observation.tick,
            kind="velocity",
            velocity_world_m_s=(float(x_m_s), float(y_m_s), max(-CLIMB_M_S, min(CLIMB_M_S, climb_m_s))),
            hold_s=self.settings.decision_s,
        )

    def direction(self, observation: Observation) -> Vector:
        """Return where to fly, kept off what is too near."""
        yaw_rad = observation.yaw_rad
        ranges_m = self.ranges.values_m(observation)
        direction = self.bug.direction(self.place_m, ranges_m, yaw_rad, list(self.others_m()))
        return remove_blocked_parts(direction, ranges_m, yaw_rad, self.settings.least_m)

    def update_waypoint(self, *, is_blocked: bool) -> None:
        """Take a new waypoint where the last one is reached, too old or blocked, or the swarm's best gets better."""
        table = self.table
        before, self.followed = self.followed, self.best
        is_better = is_other_and_better(before, self.followed, self.settings.fades_s)
        last_m = self.waypoint_m
        if last_m is not None and not is_better and not is_blocked:
            is_reached = distance(self.place_m, last_m) < table.reached_m
            if not is_reached and self.now_s - self.since_s < table.waypoint_s:
                return
        self.waypoint_m, self.since_s = self.next_waypoint(is_blocked=is_blocked), self.now_s
        self.bug.aim(self.place_m, self.waypoint_m)

    def next_waypoint(self, *, is_blocked: bool) -> Vector:
        """Return the waypoint by the swarm's rule, or the random one before any gas and where the way was blocked."""
        table = self.table
        best = self.followed
        last_m = self.place_m if self.waypoint_m is None else self.waypoint_m
        if best is None or is_blocked:
            waypoint_m = searching_waypoint(
                self.place_m, last_m, self.drawn_place(), inertia=table.search_inertia, draw=table.search_draw
            )
        else:
            own_m = np.array((self.own_best or best).place_m)
            waypoint_m = tracking_waypoint(self.place_m, last_m, own_m, np.array(best.place_m), table)
        if table.leg_m > 0.0:
            waypoint_m = self.place_m + limit_length(waypoint_m - self.place_m, table.leg_m)
        return np.array(self.room.nearest(tuple(waypoint_m)))

    def drawn_place(self) -> Vector:
        """Return a place drawn at random: from the whole room, or from a square about the robot."""
        draws, half_m = self.draws, self.table.square_m
        if half_m > 0.0:
            return self.place_m + np.array([draws.uniform(-half_m, half_m) for _ in range(2)])
        return np.array([draws.uniform(low, high) for low, high in zip(self.room.min_m[:2], self.room.max_m[:2])])


def is_other_and_better(before: Sighting | None, best: Sighting | None, fades_s: float) -> bool:
    """Return whether the best is at another place and more: the same one, sent again, may only be rounded up."""
    if before is None or best is None:
        return best is not None
    return best.place_m != before.place_m and best.amount > before.faded(best.time_s, fades_s).amount


if __name__ == "__main__":
    run(SniffyBug)
