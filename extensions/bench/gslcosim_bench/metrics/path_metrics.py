# pyright: basic
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Path metrics: lengths, distances to the sources, clearance, and declarations at the end of it.

Success and distances follow the referee: it looks at the end of each tick, counts a distance equal to the radius as
within, and does not interpolate between ticks. So give these functions the track of every tick, not a thinned one.
"Thesis" is the GSL-Bench thesis (TU Delft), chapter 7.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numba
import numpy as np
from numpy.typing import ArrayLike

from gslcosim.base.errors import ShapeError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Cell, EnvironmentGeometry, Grid
from gslcosim.environment.paths.scoring_paths import shortest_level_path_m, shortest_path_m
from gslcosim_bench.metrics.series import Array, as_points, as_series
from gslcosim_services.referee import metrics


@numba.njit(cache=True, nogil=True)
def min_distance_to_solid(points_m, is_solid, origin_m, cell_m, up_to_m):
    """Return the smallest distance of any of the points to the faces of any solid cell [m].

    d = min over points p and solid cells q of sqrt(sum over axes of max(low_q - p, p - high_q, 0)^2)

    Args:
        points_m: (n, 3) points, world frame [m].
        is_solid: (nx, ny, nz) bool, index order ij.
        origin_m: (3,) corner of cell (0, 0, 0), world frame [m].
        cell_m: Edge of the cubic cells [m].
        up_to_m: Cells farther away are not looked at [m].

    Returns:
        The distance, at most `up_to_m`; 0 inside a solid cell.

    Held by:
        extensions/bench/tests/unit/metrics/test_path_metrics.py (against brute force)
    """
    least_m2 = up_to_m * up_to_m
    away_m2 = np.empty(3)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for p in range(points_m.shape[0]):
        reach_m = math.sqrt(least_m2)
        for a in range(3):
            low[a] = max(0, math.floor((points_m[p, a] - reach_m - origin_m[a]) / cell_m))
            high[a] = min(is_solid.shape[a], math.floor((points_m[p, a] + reach_m - origin_m[a]) / cell_m) + 1)
        for i in range(low[0], high[0]):
            away_m2[0] = _gap_m(points_m[p, 0], origin_m[0] + i * cell_m, cell_m) ** 2
            for j in range(low[1], high[1]):
                away_m2[1] = _gap_m(points_m[p, 1], origin_m[1] + j * cell_m, cell_m) ** 2
                for k in range(low[2], high[2]):
                    if is_solid[i, j, k]:
                        away_m2[2] = _gap_m(points_m[p, 2], origin_m[2] + k * cell_m, cell_m) ** 2
                        least_m2 = min(least_m2, away_m2.sum())
    return math.sqrt(least_m2)


@numba.njit(cache=True, nogil=True, inline="always")
def _gap_m(value_m, low_m, cell_m):
    return max(low_m - value_m, value_m - low_m - cell_m, 0.0)


# Radii of the table of trials [m].
RADII_M = (5.0, 2.0, 1.0, 0.5)


def path_length_m(positions_m: ArrayLike) -> float:
    """Return the length of a track: the sum of the distances between its points [m].

    A track of ticks cuts the curves between them; what the world counts (`path_length_m` of a body) is as exact as
    its own steps and is preferred where it is at hand.

    Args:
        positions_m: (n, 3) positions, world frame [m].
    """
    steps_m = np.diff(as_points("positions_m", positions_m), axis=0)
    return float(np.linalg.norm(steps_m, axis=1).sum())


def distances_m(positions_m: ArrayLike, sources_m: ArrayLike, *, is_horizontal: bool = False) -> Array:
    """Return (n,) distances of each position to the source nearest to it [m].

    Args:
        positions_m: (n, 3) positions, world frame [m].
        sources_m: (m, 3) sources, world frame [m].
        is_horizontal: Whether heights do not count, as a scenario may say of its success.
    """
    positions, sources = as_points("positions_m", positions_m), as_points("sources_m", sources_m)
    axes = 2 if is_horizontal else 3
    offsets_m = positions[:, np.newaxis, :axes] - sources[np.newaxis, :, :axes]
    return np.linalg.norm(offsets_m, axis=2).min(axis=1)


def min_distance_m(positions_m: ArrayLike, sources_m: ArrayLike, *, is_horizontal: bool = False) -> float:
    """Return the smallest distance of a track to a source [m]; see `distances_m`."""
    return float(distances_m(positions_m, sources_m, is_horizontal=is_horizontal).min())


def time_within_s(t_s: ArrayLike, distance_m: ArrayLike, radius_m: float) -> float | None:
    """Return the first time at which a distance is within a radius [s]; None where it never is.

    Args:
        t_s: (n,) times, growing [s].
        distance_m: (n,) distances to the nearest source [m].
        radius_m: The radius [m]; a distance equal to it is within.
    """
    times_s = as_series("t_s", t_s)
    is_within = as_series("distance_m", distance_m, n=len(times_s)) <= radius_m
    return float(times_s[is_within.argmax()]) if is_within.any() else None


def times_within_s(
    t_s: ArrayLike, distance_m: ArrayLike, radii_m: Sequence[float] = RADII_M
) -> tuple[float | None, ...]:
    """Return the first time within each of several radii [s]; see `time_within_s`."""
    return tuple(time_within_s(t_s, distance_m, radius_m) for radius_m in radii_m)


def find_leading_agent(times_to_source_s: Sequence[float | None], nearest_by_agent_m: Sequence[float]) -> int:
    """Return the index of the agent that stands for a swarm: the first to succeed, else the one that came nearest.

    Of equals the first counts.

    Args:
        times_to_source_s: For each agent the time of its success [s], None without one.
        nearest_by_agent_m: For each agent its smallest distance to a source [m].
    """
    keys = [
        (math.inf if time_s is None else time_s, distance_m)
        for time_s, distance_m in zip(times_to_source_s, nearest_by_agent_m, strict=True)
    ]
    return min(range(len(keys)), key=keys.__getitem__)


def travel_overhead(length_m: float, shortest_m: float | None, *, success: bool) -> float | None:
    """Return the length flown in excess of the shortest path, as a fraction of it; None without success.

    See `gslcosim_services.referee.metrics.movement_overhead`, which has equation and source.
    """
    return metrics.movement_overhead(length_m, shortest_m) if success else None


def spl(length_m: float, shortest_m: float | None, *, success: bool) -> float | None:
    """Return success weighted by path length, of one run.

    SPL = S s / max(d, s)        S 1 with success, else 0; s shortest path [m], d flown [m]; dimensionless, 0 to 1

    Args:
        length_m: Length flown until success, d [m].
        shortest_m: The shortest collision-free way that suffices, s [m].
        success: S.

    Returns:
        The figure; 1 where success needed no way and none was run; None for a success without a shortest path.

    Source:
        Anderson et al. 2018, On evaluation of embodied navigation agents, arXiv:1807.06757; there the mean of
        this over runs.
    Held by:
        extensions/bench/tests/unit/metrics/test_path_metrics.py
    """
    if not success:
        return 0.0
    if shortest_m is None:
        return None
    longer_m = max(length_m, shortest_m)
    return shortest_m / longer_m if longer_m > 0.0 else 1.0


@dataclass(frozen=True, kw_only=True)
class Directness:
    """Share of a track that was progress, dimensionless.

    `towards` is net displacement along the line from start to source by length flown, -1 to 1; `magnitude` that in
    any direction, 0 to 1; `angle_rad` lies between net displacement and that line, 0 to pi, 0 where there is none.
    """

    towards: float
    magnitude: float
    angle_rad: float


def directness(
    positions_m: ArrayLike, sources_m: ArrayLike, *, length_m: float | None = None, is_horizontal: bool = False
) -> Directness | None:
    """Return net displacement by length flown, in the frame of the line from the start to the source.

    D = (1 / L) sum_k r_k (cos th_k, -sin th_k) = net displacement in that frame / L

    r_k are the lengths of the steps, th_k their angles to the line, L the sum of the r_k. [1] = [m] / [m].

    Args:
        positions_m: (n, 3) track, world frame [m]; of the tracking phase where that is meant, see `tracking_phase`.
        sources_m: (m, 3) sources, world frame [m]; the one nearest to the start counts.
        length_m: Length flown, L [m]; absent: that of the track.
        is_horizontal: Whether the height of the source does not count.

    Returns:
        The figures; None when nothing was run or the start is at the source.

    Source:
        Thesis 7.4, equation (7.1), after Pequeño-Zurro et al.; `towards` is
        `gslcosim_services.referee.metrics.directness`.
    Deviation:
        In three dimensions, so the angle has no sign: there is no left and right of a line in space.
    Held by:
        extensions/bench/tests/unit/metrics/test_path_metrics.py
    """
    track = as_points("positions_m", positions_m)
    flown_m = path_length_m(track) if length_m is None else length_m
    start_m, end_m = _vec3(track[0]), _vec3(track[-1])
    source_m = metrics.find_nearest(start_m, [_vec3(source) for source in as_points("sources_m", sources_m)])
    if is_horizontal:
        source_m = metrics.move_to_height(source_m, start_m)
    towards = metrics.directness(start_m, end_m, source_m, flown_m)
    if towards is None:
        return None
    return Directness(
        towards=towards,
        magnitude=math.dist(start_m, end_m) / flown_m,
        angle_rad=_angle_rad(np.subtract(end_m, start_m), np.subtract(source_m, start_m)),
    )


def tracking_phase(t_s: ArrayLike, positions_m: ArrayLike, first_contact_s: float | None) -> Array | None:
    """Return the part of a track from first contact with gas on, for `directness`; None without contact.

    Args:
        t_s: (n,) times, growing [s].
        positions_m: (n, 3) positions, world frame [m].
        first_contact_s: As of `contact.first_contact_s`.
    """
    track = as_points("positions_m", positions_m)
    times_s = as_series("t_s", t_s, n=len(track))
    if first_contact_s is None or first_contact_s > times_s[-1]:
        return None
    return track[int(np.searchsorted(times_s, first_contact_s)) :]


@dataclass(frozen=True, kw_only=True, eq=False)
class ShortestPaths:
    """The shortest collision-free ways to the success balls of sources, each looked for once.

    One object stands for (room, sources, radius); starts repeat from trial to trial and are then looked up. The ways
    are those of `gslcosim.environment.paths.scoring_paths`, by which the referee judges too. A field of distances
    over all cells would be quicker for many starts, but up to a tenth too long, and there would be two answers to one
    question.

    `sources_m` are points in the world frame [m]; `within_m` is the radius of the balls [m]; `clearance_m` what is kept
    from solids [m], the radius of a vehicle; `is_level` says that the way stays at the height of its start, as on
    wheels.
    """

    room: EnvironmentGeometry
    sources_m: tuple[Vec3, ...]
    within_m: float
    clearance_m: float
    is_level: bool = False
    _known_m: dict[Vec3, float | None] = field(init=False, default_factory=dict, repr=False)

    def from_m(self, start_m: Vec3) -> float | None:
        """Return the length of the shortest path from a start to the ball that is nearest by way [m].

        Returns:
            The length; 0 where the start is within a ball; None where no way leads to any.
        """
        if start_m not in self._known_m:
            lengths_m = (self._length_m(start_m, source_m) for source_m in self.sources_m)
            self._known_m[start_m] = min((length_m for length_m in lengths_m if length_m is not None), default=None)
        return self._known_m[start_m]

    def _length_m(self, start_m: Vec3, source_m: Vec3) -> float | None:
        find_length_m = shortest_level_path_m if self.is_level else shortest_path_m
        return find_length_m(self.room, start_m, source_m, clearance_m=self.clearance_m, within_m=self.within_m)


def minimum_clearance_m(
    positions_m: ArrayLike, occupancy: ArrayLike, grid: Grid, *, has_walls: bool = True, up_to_m: float = 2.0
) -> float:
    """Return the smallest distance of a track to anything solid, from the vehicle's centre [m].

    To the faces of solid cells and, with walls, to the sides and the top of the grid. The floor does not count where
    it is the bottom of the grid: vehicles start on it.

    Args:
        positions_m: (n, 3) positions, world frame [m].
        occupancy: (nx, ny, nz) cells of `Cell`.
        grid: Their grid.
        has_walls: Whether the sides and the top of the grid are solid; not so outdoors.
        up_to_m: No solid is looked for beyond this [m].

    Returns:
        The distance, at most `up_to_m`; 0 in a solid.

    Raises:
        ShapeError: the cells are not those of the grid.
    """
    track, cells = as_points("positions_m", positions_m), np.asarray(occupancy)
    if cells.shape != grid.shape:
        raise ShapeError(f"occupancy: expected shape {grid.shape}, that of its grid, was {cells.shape}.")
    least_m = min(up_to_m, max(0.0, _to_walls_m(track, grid))) if has_walls else up_to_m
    return float(min_distance_to_solid(track, cells == Cell.SOLID, np.array(grid.origin_m), grid.cell_m, least_m))


def _to_walls_m(track: Array, grid: Grid) -> float:
    low_m, high_m = track - grid.origin_m, grid.max_m - track
    return float(min(low_m[:, :2].min(), high_m.min()))


def _vec3(point: Sequence[float] | Array) -> Vec3:
    x_m, y_m, z_m = (float(coordinate_m) for coordinate_m in point)
    return x_m, y_m, z_m


def _angle_rad(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


Outcome = Literal["correct", "wrong_place", "silent", "false_alarm", "correct_silence"]


@dataclass(frozen=True, kw_only=True)
class DeclarationFigures:
    """The figures of all declarations of a run, of all its agents.

    `outcome` is the cell of the table that the first one falls into, `error_m` and `error_in_plane_m` are the distances
    of the first one to the nearest source, in space and with heights apart; absent without a declaration, and on a
    control, where there is nothing to be near to. `confidence` is the highest, 0 without one.
    """

    outcome: Outcome
    first_declared_s: float | None
    error_m: float | None
    error_in_plane_m: float | None
    confidence: float
    n_false: int


def classify_declaration(error_m: float | None, *, within_m: float, is_control: bool) -> Outcome:
    """Return the cell of the table of declarations that a run falls into.

    | | within r_s | elsewhere | none |
    |---|---|---|---|
    | source present | correct | wrong_place | silent |
    | control | false_alarm | false_alarm | correct_silence |

    Args:
        error_m: Distance of the first declaration to the nearest source [m], on a control any number; absent: none.
        within_m: Success radius r_s [m]; a distance equal to it is within.
        is_control: Whether no source gives off gas.
    """
    if is_control:
        return "correct_silence" if error_m is None else "false_alarm"
    if error_m is None:
        return "silent"
    return "correct" if error_m <= within_m else "wrong_place"


def score_declarations(
    t_s: ArrayLike,
    places_m: ArrayLike,
    confidences: ArrayLike,
    sources_m: ArrayLike,
    *,
    within_m: float,
    is_control: bool = False,
    is_horizontal: bool = False,
) -> DeclarationFigures:
    """Judge the declarations of a run, in any order; of several the earliest counts, for help would be sent there.

    Args:
        t_s: (n,) when they took effect [s]; may be empty.
        places_m: (n, 3) declared places, world frame [m].
        confidences: (n,) how sure the agents were, 0 to 1.
        sources_m: (m, 3) sources, world frame [m]; virtual ones on a control.
        within_m: Success radius [m].
        is_control: Whether no source gives off gas; then all declarations are false.
        is_horizontal: Whether heights do not count for success.

    Raises:
        ShapeError: there are not as many places or confidences as times.
    """
    if not np.size(t_s):
        outcome = classify_declaration(None, within_m=within_m, is_control=is_control)
        return DeclarationFigures(
            outcome=outcome, first_declared_s=None, error_m=None, error_in_plane_m=None, confidence=0.0, n_false=0
        )
    places = as_points("places_m", places_m)
    times_s = as_series("t_s", t_s, n=len(places))
    highest = float(as_series("confidences", confidences, n=len(places)).max())
    errors_m, in_plane_m = (distances_m(places, sources_m, is_horizontal=flat) for flat in (False, True))
    judged_m = in_plane_m if is_horizontal else errors_m
    first = int(times_s.argmin())
    return DeclarationFigures(
        outcome=classify_declaration(float(judged_m[first]), within_m=within_m, is_control=is_control),
        first_declared_s=float(times_s[first]),
        error_m=None if is_control else float(errors_m[first]),
        error_in_plane_m=None if is_control else float(in_plane_m[first]),
        confidence=highest,
        n_false=len(places) if is_control else int((judged_m > within_m).sum()),
    )
