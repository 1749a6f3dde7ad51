"""Apart from each other: the velocity by which a vehicle in the air passes others at a distance."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.quantities import Vec3
from gslcosim.world.guidance.separation_kernels import passing_costs, soonest_meeting_s

# How far ahead vehicles look [s]. Chosen: at 1 m/s each, two of them see one another 8 m apart.
LOOKS_AHEAD_S = 4.0
# What a second less until they meet costs against a velocity other than the wanted one [m]; chosen.
_MEETING_COSTS_M = 3.0
_SOONEST_S = 0.05
# Turns away from the wanted direction [rad], to the right first: of equally good ones the first is taken.
_TURNS_RAD = tuple(side * i * math.pi / 8 for i in range(9) for side in ((-1, 1) if 0 < i < 8 else (-1,)))
_SPEED_SHARES = (1.0, 0.5)
# What turns a wanted velocity into those that are tried, (k, 3) cosine, sine and share of the climb: all turns at full
# and at half speed, then none.
_TRIED = np.array(
    [(share * math.cos(a), share * math.sin(a), share) for share in _SPEED_SHARES for a in _TURNS_RAD]
    + [(0.0, 0.0, 0.0)]
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Neighbours:
    """All vehicles as one of them sees them; `own` is its index.

    `positions_m` and `velocities_m_s` are (n, 3), world frame; `least_m` is (n,), what it keeps from each [m];
    `gives_way` (n,) says which of them do their half of keeping apart.
    """

    own: int
    positions_m: NDArray[np.float64]
    velocities_m_s: NDArray[np.float64]
    least_m: NDArray[np.float64]
    gives_way: NDArray[np.bool_]


def meets_within(wanted_m_s: Vec3, neighbours: Neighbours, within_s: float) -> bool:
    """Return whether a velocity, kept, brings a vehicle nearer to another one than it may be, within a time [s]."""
    others = (neighbours.positions_m, neighbours.velocities_m_s, neighbours.least_m)
    return bool(soonest_meeting_s(neighbours.own, wanted_m_s, *others) < within_s)


def passing_velocity(wanted_m_s: Vec3, neighbours: Neighbours, is_open: Callable[[Vec3], bool]) -> Vec3:
    """Return the velocity with which a vehicle gets past others.

    Reciprocal velocity obstacles: who shares the work with the other changes its velocity by half of what is needed.
    What velocities cost is in `passing_costs`; the cheapest that leads to free places is taken.

    Args:
        wanted_m_s: Velocity that it would take alone, world frame [m/s], not zero.
        neighbours: The others, and its own velocity.
        is_open: Whether a velocity leads to free places.

    Source:
        van den Berg, Lin and Manocha 2008, Reciprocal velocity obstacles for real-time multi-agent navigation,
        doi:10.1109/ROBOT.2008.4543489, sections IV and V.
    Deviation:
        Velocities are tried on a fixed grid instead of drawn: turned about the vertical, to the right first.
    Held by:
        tests/unit/world/guidance/test_separation.py
    """
    tried = _velocities(wanted_m_s)
    costs = passing_costs(
        tried,
        neighbours.own,
        wanted_m_s,
        neighbours.positions_m,
        neighbours.velocities_m_s,
        neighbours.least_m,
        neighbours.gives_way,
        LOOKS_AHEAD_S,
        _SOONEST_S,
        _MEETING_COSTS_M,
    )
    for i in np.argsort(costs.round(9), kind="stable"):
        u, v, w = tried[i].tolist()
        if is_open((u, v, w)):
            return u, v, w
    return 0.0, 0.0, 0.0


def rehearse_separation() -> None:
    """Pass a made-up vehicle once, so that no kernel is compiled or loaded while simulated time passes."""
    places_m = np.array([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    is_giving_way = np.ones(2, np.bool_)
    ahead = Neighbours(
        own=0, positions_m=places_m, velocities_m_s=-places_m, least_m=np.ones(2), gives_way=is_giving_way
    )
    if meets_within((1.0, 0.0, 0.0), ahead, LOOKS_AHEAD_S):
        passing_velocity((1.0, 0.0, 0.0), ahead, lambda _: True)


def _velocities(wanted_m_s: Vec3) -> NDArray[np.float64]:
    u, v, w = wanted_m_s
    cosine, sine, share = _TRIED.T
    return np.stack([cosine * u - sine * v, sine * u + cosine * v, share * w], axis=1)
