"""Apart from each other: the velocity by which a vehicle in the air passes others at a distance."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.world.trajectory import Vec3

# How far ahead vehicles look [s]. Chosen: at 1 m/s each, two of them see one another 8 m apart.
LOOKS_AHEAD_S = 4.0
# What a second less until they meet costs against a velocity other than the wanted one [m]; chosen.
_MEETING_COSTS_M = 3.0
_SOONEST_S = 0.05
# Turns away from the wanted direction [rad], to the right first: of equally good ones the first is taken.
_TURNS_RAD = tuple(side * i * math.pi / 8 for i in range(9) for side in ((-1, 1) if 0 < i < 8 else (-1,)))
_SPEED_SHARES = (1.0, 0.5)


@dataclass(frozen=True, kw_only=True)
class Neighbour:
    """Another vehicle as one sees it: its place from here [m] and velocity [m/s], world frame, and what to keep.

    `gives_way` says that it does its half of keeping apart.
    """

    offset_m: Vec3
    velocity_m_s: Vec3
    least_m: float
    gives_way: bool


def meets_within(wanted_m_s: Vec3, neighbours: Sequence[Neighbour], within_s: float) -> bool:
    """Return whether a velocity, kept, brings a vehicle nearer to another one than it may be, within a time [s]."""
    if not neighbours:
        return False
    towards = np.array(wanted_m_s) - np.array([other.velocity_m_s for other in neighbours])
    return bool((_meeting_s(towards[np.newaxis], neighbours) < within_s).any())


def passing_velocity(
    wanted_m_s: Vec3, own_m_s: Vec3, neighbours: Sequence[Neighbour], is_open: Callable[[Vec3], bool]
) -> Vec3:
    """Return the velocity with which a vehicle gets past others.

    Reciprocal velocity obstacles: who shares the work with the other changes its velocity by half of what is needed.
    A velocity v costs |v - wanted| + w / t, t the time until the two are too near, when the other keeps its velocity u:
    they then approach with 2 v - own - u where both give way, else with v - u.
    [m/s] = [m/s] + [m] / [s]

    Args:
        wanted_m_s: Velocity that it would take alone, world frame [m/s], not zero.
        own_m_s: Velocity that it has [m/s].
        neighbours: The others.
        is_open: Whether a velocity leads to free places.

    Source:
        van den Berg, Lin and Manocha 2008, Reciprocal velocity obstacles for real-time multi-agent navigation,
        doi:10.1109/ROBOT.2008.4543489, sections IV and V.
    Deviation:
        Velocities are tried on a fixed grid instead of drawn: turned about the vertical, to the right first.
    Held by:
        tests/unit/world/test_separation.py
    """
    tried = _velocities(wanted_m_s)
    others = np.array([other.velocity_m_s for other in neighbours])
    shares = np.array([0.5 if other.gives_way else 1.0 for other in neighbours])[:, np.newaxis]
    changed = np.array(own_m_s) + (tried[:, np.newaxis] - own_m_s) / shares
    meeting_s = _meeting_s(changed - others, neighbours).min(axis=1)
    costs = np.linalg.norm(tried - wanted_m_s, axis=1)
    costs += np.where(meeting_s < LOOKS_AHEAD_S, _MEETING_COSTS_M / np.maximum(meeting_s, _SOONEST_S), 0.0)
    for i in np.argsort(costs.round(9), kind="stable"):
        u, v, w = tried[i].tolist()
        if is_open((u, v, w)):
            return u, v, w
    return 0.0, 0.0, 0.0


# All turns at full and at half speed, then none.
def _velocities(wanted_m_s: Vec3) -> NDArray[np.float64]:
    u, v, w = wanted_m_s
    turned = [
        (share * (math.cos(a) * u - math.sin(a) * v), share * (math.sin(a) * u + math.cos(a) * v), share * w)
        for share in _SPEED_SHARES
        for a in _TURNS_RAD
    ]
    return np.array([*turned, (0.0, 0.0, 0.0)])


# Seconds until two are too near, (velocities, neighbours): the first root of |p - v t| = d. Who is too near already
# meets at once when it comes nearer still, else never.
def _meeting_s(towards_m_s: NDArray[np.float64], neighbours: Sequence[Neighbour]) -> NDArray[np.float64]:
    offsets_m = np.array([other.offset_m for other in neighbours])
    least_m = np.array([other.least_m for other in neighbours])
    closing = (towards_m_s * offsets_m).sum(axis=-1)
    speed2 = (towards_m_s**2).sum(axis=-1)
    gap_m2 = (offsets_m**2).sum(axis=-1) - least_m**2
    under_root = closing**2 - speed2 * gap_m2
    with np.errstate(invalid="ignore", divide="ignore"):
        first_s = (closing - np.sqrt(under_root)) / speed2
    meeting_s = np.where((under_root > 0) & (closing > 0), first_s, np.inf)
    return np.where((gap_m2 <= 0) & (closing > 0), 0.0, meeting_s)
