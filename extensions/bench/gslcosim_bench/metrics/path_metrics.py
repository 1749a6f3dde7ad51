# pyright: basic

"""Path metrics: lengths, distances to the sources, clearance, and declarations at the end of it.

Success and distances follow the referee: it looks at the end of each tick, counts a distance equal to the radius as
within, and does not interpolate between ticks. So give these functions the track of every tick, not a thinned one.
"Thesis" is the GSL-Bench thesis (TU Delft), chapter 7.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gslcosim.base.quantities import Vec3
from gslcosim_bench.metrics.series import Array, as_points, as_series
from gslcosim_services.referee import metrics

# Radii of the table of trials [m].
RADII_M = (5.0, 2.0, 1.0, 0.5)
Outcome = Literal["correct", "wrong_place", "silent", "false_alarm", "correct_silence"]


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


def _vec3(point: Sequence[float] | Array) -> Vec3:
    x_m, y_m, z_m = (float(coordinate_m) for coordinate_m in point)
    return x_m, y_m, z_m


def _angle_rad(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


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
