"""Plume search of a team: lanes across the wind, and casts about the last place with gas."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.search.motion.legs import LegSpace
from gslcosim.search.reactive.cast_and_surge import CastSequence

Floats = NDArray[np.float64]


def nearest_axis_rad(heading_rad: float) -> float:
    """Return the direction of the room's axis that is nearest to a heading: 0, pi/2, pi or -pi/2 [rad]."""
    return math.remainder(round(heading_rad / (math.pi / 2.0)) * (math.pi / 2.0), 2.0 * math.pi)


def plan_crosswind_lanes(room: LegSpace, upwind_rad: float, lane_m: float, *, inset_m: float = 0.0) -> Floats:
    """Return the (m, 2) turns of lanes back and forth across the wind, one after the other up the wind.

    Lanes lie along the axis of the room that is nearest to across the wind, as few as cover the room when each covers
    `lane_m`: n = ceil(L / lane), L / n apart and L / (2 n) from the walls.

    Args:
        room: Where the lanes lie.
        upwind_rad: Direction the wind comes from, world frame [rad].
        lane_m: How wide a lane is at most [m].
        inset_m: How far before the room's sides the lanes turn [m]; at most to the middle.

    Source:
        Marjovi and Marques 2013 (abstract: sweeps across the wind). Lanes along walls are ours: they leave no corner.
    Held by:
        tests/unit/search/swarms/test_plume_search.py (no place is farther than half a lane from the lanes)
    """
    along_rad = nearest_axis_rad(upwind_rad)
    along = 0 if abs(math.cos(along_rad)) > 0.5 else 1
    across = 1 - along
    low_m, high_m = np.array(room.min_m[:2]), np.array(room.max_m[:2])
    n = max(1, math.ceil((high_m - low_m)[along] / lane_m - 1e-9))
    lanes_m = low_m[along] + (np.arange(n) + 0.5) * (high_m - low_m)[along] / n
    if math.cos(along_rad) + math.sin(along_rad) < 0.0:
        lanes_m = lanes_m[::-1]
    middle_m = 0.5 * (low_m + high_m)[across]
    ends_m = (min(low_m[across] + inset_m, middle_m), max(high_m[across] - inset_m, middle_m))
    turns_m = np.empty((2 * n, 2))
    turns_m[:, along] = np.repeat(lanes_m, 2)
    turns_m[:, across] = [ends_m[(i + j) % 2] for i in range(n) for j in range(2)]
    return turns_m


def find_lane_point(lanes_m: Floats, distance_m: float) -> Floats:
    """Return the place (2,) after a distance along lanes [m]; after its end it begins again at its beginning."""
    lengths_m = np.hypot(*np.diff(lanes_m, axis=0).T)
    total_m = float(lengths_m.sum())
    if total_m == 0.0:
        return lanes_m[0]
    rest_m = distance_m % total_m
    for start_m, end_m, length_m in zip(lanes_m, lanes_m[1:], lengths_m):
        if rest_m <= length_m and length_m > 0.0:
            return start_m + rest_m / length_m * (end_m - start_m)
        rest_m -= length_m
    return lanes_m[-1]


def find_next_lane_point(lanes_m: Floats, place_m: Sequence[float] | Floats, step_m: float) -> Floats:
    """Return where to go from a place to follow lanes: a step on from its nearest point, from its end to its start.

    It needs no memory, so all of a team that know where they are go the same way.

    Args:
        lanes_m: (m, 2) turns [m].
        place_m: Where the team is [m].
        step_m: How far along the lanes [m].

    Held by:
        tests/unit/search/swarms/test_plume_search.py
    """
    place = np.asarray(place_m[:2], dtype=np.float64)
    starts_m, spans_m = lanes_m[:-1], np.diff(lanes_m, axis=0)
    lengths_m = np.hypot(spans_m[:, 0], spans_m[:, 1])
    fractions = np.sum((place - starts_m) * spans_m, axis=1) / np.maximum(lengths_m, 1e-9) ** 2
    fractions = np.clip(fractions, 0.0, 1.0)
    away_m = np.hypot(*(starts_m + fractions[:, None] * spans_m - place).T)
    # The last of equally near pieces, so that a turn leads on and not back.
    i = len(away_m) - 1 - int(np.argmin(np.round(away_m[::-1], 6)))
    along_m = float(lengths_m[:i].sum() + fractions[i] * lengths_m[i])
    total_m = float(lengths_m.sum())
    if total_m - along_m < 0.05:
        return lanes_m[0]
    return lanes_m[-1] if along_m + step_m >= total_m else find_lane_point(lanes_m, along_m + step_m)


class PlumeMemory:
    """Goals of a team while it has no gas: casts about the last place with gas, then the lanes.

    State: the last place with gas and the wind there, and how far the cast about it has come.

    Source:
        Casting as in Lochmatter and Martinoli 2008; of a whole formation, ours.
    Held by:
        tests/unit/search/swarms/test_plume_search.py
    """

    def __init__(self, lanes_m: Floats, *, step_m: float, cast_m: float, n_casts: int) -> None:
        """Prepare for a search without gas.

        Args:
            course_m: (m, 2) turns of the lanes [m].
            step_m: Step along the course [m].
            cast_m: First leg of a cast [m].
            n_casts: Legs of a cast before the lanes are taken up again; 0 for none.
        """
        self._lanes_m, self._step_m, self._cast_m, self._n_casts = lanes_m, step_m, cast_m, n_casts
        self._cast: CastSequence | None = None

    def met_gas(self, place_m: Sequence[float] | Floats, upwind_rad: float) -> None:
        """Take note that there is gas at the team's place."""
        anchor_m = (float(place_m[0]), float(place_m[1]))
        self._cast = CastSequence(
            anchor_m=anchor_m, upwind_rad=upwind_rad, side=1, width_m=self._cast_m, n_legs=self._n_casts
        )

    def next_place_m(self, place_m: Sequence[float] | Floats) -> Floats:
        """Return where to go from the team's place without gas (2,) [m]."""
        turn_m = None if self._cast is None else self._cast.next_turn_m()
        if turn_m is not None:
            return np.array(turn_m)
        self._cast = None
        return find_next_lane_point(self._lanes_m, place_m, self._step_m)
