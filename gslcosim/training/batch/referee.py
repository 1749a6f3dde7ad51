"""Referee of one search; see `gslcosim_services.referee`."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
# pyright: basic, reportCallIssue=false

from gslcosim.training.batch.batch_records import (
    COLLISION,
    NEAREST_SOURCE,
    OUT_OF_BOUNDS,
    SEARCHES_ON,
    SUCCESS,
    TIME_LIMIT,
)
from gslcosim.training.batch.free_space import is_in_room, norm3, seconds_of
from gslcosim.training.batch.reference_free_kernels import reference_free_njit


@reference_free_njit()
def _distance_m(case, sources_m, i, p):
    source_m = sources_m[case.first_source + i]
    rise_m = 0.0 if case.is_horizontal else p[2] - source_m[2]
    return norm3(p[0] - source_m[0], p[1] - source_m[1], rise_m)


@reference_free_njit()
def judge_inplace(search, case, room, sources_m, tick):
    """Judge a tick when its commands are known, and keep the score.

    Args:
        search: Record of `SEARCH`.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        sources_m: (n, 3) sources of all cases, world frame [m].
        tick: The tick that ended.

    Returns:
        Whether the search is over.

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    if search.command_tick == tick:
        search.n_commands += 1
    nearest_m = _distance_m(case, sources_m, 0, search.position_m)
    is_within = nearest_m <= case.within_m
    found = 1 if is_within else 0
    for i in range(1, case.n_sources):
        distance_m = _distance_m(case, sources_m, i, search.position_m)
        nearest_m = min(nearest_m, distance_m)
        if distance_m <= case.within_m:
            is_within = True
            found |= 1 << i
    search.scored_distance_m = nearest_m
    search.scored_path_length_m = search.path_length_m
    search.scored_n_commands = search.n_commands
    if search.is_touching and case.ends_on_collision:
        search.outcome = COLLISION
    elif not is_in_room(room, search.position_m):
        search.outcome = OUT_OF_BOUNDS
    else:
        search.found_sources |= found
        is_met = is_within
        if case.criterion != NEAREST_SOURCE:
            is_met = search.found_sources == (1 << case.n_sources) - 1
        if is_met:
            search.outcome = SUCCESS
    if search.outcome == SEARCHES_ON and seconds_of(tick, case.tick_ns) >= case.time_limit_s:
        search.outcome = TIME_LIMIT
    return search.outcome != SEARCHES_ON
