"""Metrics of searches and beliefs, as pure functions of lengths, positions and probabilities.

Sources: "thesis" is the GSL-Bench thesis (TU Delft), chapter 7 on performance metrics.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.base import elementary
from gslcosim.base.quantities import Vec3
from gslcosim.base.scalar_kernels import distance, norm3, scalar_kernel
from gslcosim.contract.messages import Belief, BeliefScore

Array = NDArray[np.float64]


def distance_m(a_world_m: Vec3, b_world_m: Vec3) -> float:
    """Return the straight distance between two points [m]."""
    return distance(a_world_m, b_world_m)


@scalar_kernel
def source_distance_m(
    point_world_m: Sequence[float],
    source_world_m: Sequence[float],
    is_horizontal: bool,  # noqa: FBT001 - a kernel
) -> float:
    """Return the distance of a point from a source [m], in the plane where heights do not count.

    Args:
        point_world_m: (3,) point, world frame [m].
        source_world_m: (3,) source, world frame [m].
        is_horizontal: Only the distance in the plane counts.
    """
    rise_m = 0.0 if is_horizontal else point_world_m[2] - source_world_m[2]
    return norm3(point_world_m[0] - source_world_m[0], point_world_m[1] - source_world_m[1], rise_m)


def find_nearest(point_world_m: Vec3, places_world_m: Sequence[Vec3]) -> Vec3:
    """Return the place nearest to a point; the first of several equally near ones.

    Args:
        point_world_m: Point, world frame [m].
        places_world_m: At least one place, world frame [m].
    """
    return min(places_world_m, key=lambda place_m: distance(point_world_m, place_m))


def move_to_height(place_world_m: Vec3, point_world_m: Vec3) -> Vec3:
    """Return a place moved up or down to the height of a point, world frame [m]."""
    return (place_world_m[0], place_world_m[1], point_world_m[2])


def movement_overhead(path_length_m: float, shortest_path_m: float | None) -> float | None:
    """Return the excess of the path length over the shortest possible, as a fraction of the latter.

    alpha = d / s - 1        d path length [m], s shortest [m]; dimensionless, 0 for the best run

    Args:
        path_length_m: Length of the path until the source was found [m].
        shortest_path_m: Shortest collision-free length that would have sufficed [m]; absent: there is none.

    Returns:
        The overhead; None where there is no shortest path or it has no length.

    Source:
        Thesis 7.3, alpha = d / Delta - 1, there with the straight line.
    Deviation:
        The shortest path around obstacles instead of the straight line (the thesis names both), and only up to the
        success radius, where runs end: with the path to the source itself, straight runs would have a negative
        overhead.
    Held by:
        tests/unit/services/referee/test_metrics.py
    """
    if not shortest_path_m:
        return None
    return path_length_m / shortest_path_m - 1.0


def directness(start_world_m: Vec3, end_world_m: Vec3, source_world_m: Vec3, path_length_m: float) -> float | None:
    """Return the fraction of the path length that was progress along the line from the start to the source.

    D = (1 / L) sum_i r_i cos(theta_i) = (p_end - p_start) . u / L,    u = (p_source - p_start) / |p_source - p_start|

    r_i are the lengths of the N parts of the trajectory, theta_i their angles to u, L the sum of the r_i. The sum of
    projections is the projection of the sum, so only start, end and L are needed. Dimensionless: [m] / [m];
    1 straight to the source, 0 no progress, -1 straight away.

    Args:
        start_world_m: Position of the vehicle at tick 0, world frame [m].
        end_world_m: Position at the end of its run, world frame [m].
        source_world_m: The source nearest to the start, world frame [m].
        path_length_m: Length of the path, L [m].

    Returns:
        The directness; None for a path without length or a start at the source.

    Source:
        Thesis 7.4, equation (7.1), after Pequeño-Zurro et al.
    Deviation:
        In three dimensions, and only the component towards the source: it alone separates good from bad.
    Held by:
        tests/unit/services/referee/test_metrics.py, tests/properties/test_referee_metrics.py
    """
    to_source_m = distance(start_world_m, source_world_m)
    if path_length_m <= 0.0 or to_source_m <= 0.0:
        return None
    progress_m2 = sum(
        (end - start) * (source - start)
        for start, end, source in zip(start_world_m, end_world_m, source_world_m, strict=True)
    )
    return progress_m2 / to_source_m / path_length_m


def compute_belief_score(belief: Belief, sources_m: Sequence[Vec3], *, within_m: float) -> BeliefScore:
    """Return the figures of a belief; one with two axes is judged in the plane.

    Args:
        belief: A probability for each cell.
        sources_m: The sources, world frame [m]; of several the nearest to each cell counts.
        within_m: The success radius [m].

    Held by:
        tests/unit/services/referee/test_beliefs.py
    """
    # In double precision their sum is 1 to its last digits.
    p = belief.probability.to_array().astype(np.float64)
    p = p / p.sum()
    distances_m = _distances_to_nearest_m(belief, sources_m)
    return BeliefScore(
        expected_distance_m=expected_distance_m(p, distances_m),
        mass_near_frac=_fraction(p[distances_m <= within_m].sum()),
        cell_frac=_fraction(sum(p[cell] for cell in _find_source_cells(belief, sources_m))),
        entropy_bits=entropy_bits(p),
    )


def expected_distance_m(p: Array, distances_m: Array) -> float:
    """Return the earth mover's distance of a belief to a point mass at the source [m].

    E = sum_i p_i d_i        [m] = [1] [m]

    To move all of it to one place there is one way only, so no optimiser is needed.

    Args:
        p: Probabilities, sum 1.
        distances_m: Distance of each cell's centre from the source [m], of the same shape.
    """
    return float((p * distances_m).sum())


def entropy_bits(p: Array) -> float:
    """Return the entropy H = -sum p log2 p [bit] (Shannon 1948); cells without probability add nothing."""
    positive = p[p > 0.0]
    return max(0.0, float(-(positive * elementary.log2_each(positive)).sum()))


def _distances_to_nearest_m(belief: Belief, sources_m: Sequence[Vec3]) -> Array:
    shape = belief.probability.shape
    axes_m = [belief.origin_m[k] + (np.arange(n) + 0.5) * belief.cell_m for k, n in enumerate(shape)]
    centres_m = np.stack(np.meshgrid(*axes_m, indexing="ij"), axis=-1)
    squares_m2 = [np.square(centres_m - np.array(source_m[: len(shape)])).sum(axis=-1) for source_m in sources_m]
    return np.sqrt(np.min(squares_m2, axis=0))


# The cells that hold a source; one outside of the belief's grid is in none.
def _find_source_cells(belief: Belief, sources_m: Sequence[Vec3]) -> set[tuple[int, ...]]:
    shape = belief.probability.shape
    origin_m = np.array(belief.origin_m[: len(shape)])
    found: set[tuple[int, ...]] = set()
    for source_m in sources_m:
        index = np.floor((np.array(source_m[: len(shape)]) - origin_m) / belief.cell_m).astype(int)
        if np.all((index >= 0) & (index < shape)):
            found.add(tuple(int(i) for i in index))
    return found


def _fraction(value: float) -> float:
    return min(1.0, max(0.0, float(value)))
