"""When a vehicle is where it was going, when it never will be, and when it lies on its back."""

import math
from typing import Literal

from gslcosim.quantities import Vec3
from gslcosim.ticks import ticks_from_seconds
from gslcosim.world.guidance.course import Course
from gslcosim.world.paths.space import FlightSpace

# When a vehicle counts as being at its waypoint, and how long after the end of its trajectory it may take.
ARRIVED_WITHIN_M = 0.15
ARRIVED_BELOW_M_S = 0.2
GIVE_UP_AFTER_S = 10.0
BACK_OFF_M = 0.1
# A vehicle that lies on its side or back this long, and hardly moves, will not get up.
OVERTURNED_BELOW = 0.3
OVERTURNED_FOR_S = 1.0

OVERTURNED = "vehicle: expected to stand upright, was lying on its side or back; it cannot move any more."


def arrival_of(tick: int, course: Course) -> Literal["under_way", "passed", "there", "late"]:
    """Return how far a vehicle has come on its leg at the end of a tick.

    It passes or reaches the end of its path, or has not come near it long after it should.
    """
    if not course.is_over(tick):
        return "under_way"
    if course.leg is not None and course.leg.is_passed:
        return "passed"
    distance_m = math.dist(course.position_m, course.trajectory.end_world_m)
    if distance_m <= ARRIVED_WITHIN_M and math.hypot(*course.velocity_m_s) < ARRIVED_BELOW_M_S:
        return "there"
    return "late" if course.late_s(tick) >= GIVE_UP_AFTER_S else "under_way"


def give_up(tick: int, course: Course, space: FlightSpace) -> str:
    """Let a vehicle rest a little back from where it got stuck, so that it no longer touches what is in the way.

    Args:
        tick: The tick that ended.
        course: Its course; changed.
        space: Where it may be.

    Returns:
        What to tell the agent.
    """
    end_m = course.trajectory.end_world_m
    distance_m = math.dist(course.position_m, end_m)
    back = BACK_OFF_M / distance_m if distance_m > ARRIVED_WITHIN_M else 0.0
    x_m, y_m, z_m = (p + back * (p - end) for p, end in zip(course.position_m, end_m, strict=True))
    is_free = space.refusal("back", (x_m, y_m, z_m)) is None
    course.stay(tick, (x_m, y_m, z_m) if is_free else course.position_m)
    return (
        f"waypoint: expected to arrive within {GIVE_UP_AFTER_S:g} s of the planned time, "
        f"was still {distance_m:.2f} m away; the vehicle holds there."
    )


class OverturnWatch:
    """Notices that a vehicle lies on its side or back and will not get up.

    State: the tick since which it lies, and whether it has been given up.
    """

    def __init__(self, tick_ns: int) -> None:
        self._patience_ticks = ticks_from_seconds(OVERTURNED_FOR_S, tick_ns)
        self.is_overturned = False
        self._since_tick: int | None = None

    def sees_fall(self, tick: int, uprightness: float, velocity_m_s: Vec3) -> bool:
        """Return whether at this tick the vehicle has to be given up.

        Args:
            tick: The tick that ended.
            uprightness: Cosine of the angle between the vehicle's z axis and the vertical.
            velocity_m_s: Its velocity [m/s].
        """
        if uprightness >= OVERTURNED_BELOW or math.hypot(*velocity_m_s) >= ARRIVED_BELOW_M_S:
            self._since_tick = None
            return False
        if self._since_tick is None:
            self._since_tick = tick
        if self.is_overturned or tick - self._since_tick < self._patience_ticks:
            return False
        self.is_overturned = True
        return True
