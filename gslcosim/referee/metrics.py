"""The figures by which searches are compared, as pure functions of lengths and places.

Sources: "thesis" is the GSL-Bench thesis (TU Delft), chapter 7 on performance metrics.
"""

import math
from collections.abc import Sequence

from gslcosim.quantities import Vec3


def distance_m(a_world_m: Vec3, b_world_m: Vec3) -> float:
    """Return the straight distance between two points [m]."""
    return math.dist(a_world_m, b_world_m)


def nearest(point_world_m: Vec3, places_world_m: Sequence[Vec3]) -> Vec3:
    """Return the place nearest to a point; the first of several equally near ones.

    Args:
        point_world_m: Point, world frame [m].
        places_world_m: At least one place, world frame [m].
    """
    return min(places_world_m, key=lambda place_m: math.dist(point_world_m, place_m))


def at_height_of(place_world_m: Vec3, point_world_m: Vec3) -> Vec3:
    """Return a place moved up or down to the height of a point, world frame [m]."""
    return (place_world_m[0], place_world_m[1], point_world_m[2])


def movement_overhead(path_length_m: float, shortest_path_m: float | None) -> float | None:
    """Return the flown length in excess of the shortest possible, as a fraction of the latter.

    alpha = d / s - 1        d flown [m], s shortest [m]; dimensionless, 0 for the best flight

    Args:
        path_length_m: Length flown until the source was found [m].
        shortest_path_m: Shortest collision-free length that would have sufficed [m]; absent: there is none.

    Returns:
        The overhead; None where there is no shortest path or it has no length.

    Source:
        Thesis 7.3, alpha = d / Delta - 1, there with the straight line.
    Deviation:
        The shortest way around obstacles instead of the straight line (the thesis names both), and only as far as
        the success radius, where runs end: with the way to the source itself straight flights would have a negative
        overhead.
    Held by:
        tests/unit/referee/test_metrics.py
    """
    if not shortest_path_m:
        return None
    return path_length_m / shortest_path_m - 1.0


def directness(start_world_m: Vec3, end_world_m: Vec3, source_world_m: Vec3, path_length_m: float) -> float | None:
    """Return which part of the flown length was progress along the line from the start to the source.

    D = (1 / L) sum_i r_i cos(theta_i) = (p_end - p_start) . u / L,    u = (p_source - p_start) / |p_source - p_start|

    r_i are the lengths of the N parts of the trajectory, theta_i their angles to u, L the sum of the r_i. The sum of
    projections is the projection of the sum, so only start, end and L are needed. Dimensionless: [m] / [m];
    1 straight to the source, 0 no progress, -1 straight away.

    Args:
        start_world_m: Where the vehicle stood at tick 0, world frame [m].
        end_world_m: Where its run ended, world frame [m].
        source_world_m: The source nearest to the start, world frame [m].
        path_length_m: Length flown, L [m].

    Returns:
        The directness; None when nothing was flown or the start is at the source.

    Source:
        Thesis 7.4, equation (7.1), after Pequeño-Zurro et al.
    Deviation:
        In three dimensions, and only the component towards the source: it alone tells good from bad.
    Held by:
        tests/unit/referee/test_metrics.py, tests/properties/test_referee_metrics.py
    """
    to_source_m = math.dist(start_world_m, source_world_m)
    if path_length_m <= 0.0 or to_source_m <= 0.0:
        return None
    progress_m2 = sum(
        (end - start) * (source - start)
        for start, end, source in zip(start_world_m, end_world_m, source_world_m, strict=True)
    )
    return progress_m2 / to_source_m / path_length_m
