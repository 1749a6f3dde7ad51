"""Searches from question to question: vehicle, gas, sensors and referee, tick by tick, each search for itself."""
# pyright: basic

from typing import Any, NamedTuple

import numba
import numpy as np

from gslcosim.fields.models.formula_plume_kernels import steady_ppm
from gslcosim.training.batch.batch_records import (
    MOST_GASES,
    NO_TASK,
    ON_GROUND,
    SEARCHES_ON,
    STEADY_PLUMES,
)
from gslcosim.training.batch.drawing_kernels import seed_inplace
from gslcosim.training.batch.exact_kernels import norm3
from gslcosim.training.batch.guiding_kernels import end_tick, hear, seconds_of, take_off
from gslcosim.training.batch.judging_kernels import judge_inplace
from gslcosim.training.batch.sensing_kernels import read_inplace, tell_pose_inplace, tell_reading_inplace
from gslcosim.training.batch.space_kernels import touches, wind_at_inplace
from gslcosim.world.physics.flight_kernels import path_force_inplace


class Cases(NamedTuple):
    """All cases, read-only: (n,) records of `ROOM`, `CASE`, `records.CONSTANTS` and `PLUME`, and what they point into.

    `instruments` (n_cases, n_sensors) records of `INSTRUMENT`; `names` bytes of their random streams; `start_rows`
    (n, 7) place, velocity and touching at the end of each tick in which a vehicle leaves what it stands on;
    `sources_m` (n, 3); `places_m` (n_cases, n_places, 3) of the sensors in the body frame [m].
    """

    rooms: Any
    cases: Any
    vehicles: Any
    plumes: Any
    instruments: Any
    names: Any
    start_rows: Any
    sources_m: Any
    places_m: Any


class Searches(NamedTuple):
    """All searches: (n,) records of `SEARCH` and `records.STATE`, (n, n_sensors) of `GAUGE`."""

    searches: Any
    paths: Any
    gauges: Any


class Work(NamedTuple):
    """Scratch of one thread: (3, 3, 3) states, two records of `records.STATE`, and what is true at the sensors."""

    states: Any
    paths: Any
    ppm: Any
    wind_m_s: Any
    raw: Any


@numba.njit(cache=True, nogil=True)
def _fly_tick(search, path, vehicle, case, room, tick):
    # A point robot is a mass that its force moves; MuJoCo's semi-implicit Euler step of a free body, to the bit.
    p, v = search.position_m, search.velocity_m_s
    dt_s, step_s = case.tick_s / case.n_substeps, case.physics_step_s
    x_m, y_m, z_m = p[0], p[1], p[2]
    for i_substep in range(case.n_substeps):
        if touches(room, case.radius_m, p):
            search.is_touching = 1
        t_s = (tick - 1 - path.start_tick) * case.tick_s + i_substep * dt_s
        f_x, f_y, f_z, _, _, _ = path_force_inplace(vehicle, path, p, v, t_s, dt_s)
        v[0] += step_s * f_x
        v[1] += step_s * f_y
        v[2] += step_s * (f_z - vehicle.gravity_m_s2)
        p[0] += step_s * v[0]
        p[1] += step_s * v[1]
        p[2] += step_s * v[2]
    search.path_length_m += norm3(p[0] - x_m, p[1] - y_m, p[2] - z_m)


@numba.njit(cache=True, nogil=True)
def _leave_start(search, case, start_rows, tick):
    row, p = start_rows[case.first_start_row + tick], search.position_m
    search.path_length_m += norm3(row[0] - p[0], row[1] - p[1], row[2] - p[2])
    for axis in range(3):
        p[axis] = row[axis]
        search.velocity_m_s[axis] = row[3 + axis]
    if row[6] != 0.0:
        search.is_touching = 1


@numba.njit(cache=True, nogil=True)
def _sense(search, gauges, cases, case, i_case, room, work, tick):
    p, v = search.position_m, search.velocity_m_s
    time_s = case.warm_up_s + seconds_of(tick, case.tick_ns)
    places_m = cases.places_m
    for n in range(places_m.shape[1]):
        x_m, y_m, z_m = p[0] + places_m[i_case, n, 0], p[1] + places_m[i_case, n, 1], p[2] + places_m[i_case, n, 2]
        for g in range(case.n_gases):
            work.ppm[n, g] = 0.0
        if case.gas == STEADY_PLUMES:
            for k in range(case.first_plume, case.first_plume + case.n_plumes):
                work.ppm[n, cases.plumes[k].gas] += steady_ppm(cases.plumes[k], x_m, y_m, z_m)
        wind_at_inplace(work.wind_m_s[n], room, time_s, x_m, y_m, z_m)
    for k in range(gauges.shape[0]):
        instrument = cases.instruments[i_case, k]
        n = instrument.place
        read_inplace(instrument, gauges[k], tick, case.tick_s, case.n_gases, work.ppm[n], work.wind_m_s[n], v, work.raw)


@numba.njit(cache=True, nogil=True)
def _go_on(search, path, gauges, cases, work, tick, task, vector):
    # From the end of a tick, which is judged, to the next question or the end.
    i_case = search.case
    case, vehicle = cases.cases[i_case], cases.vehicles[i_case]
    room = cases.rooms[case.room]
    while True:
        tick += 1
        search.tick = tick
        search.is_touching = 0
        if tick == 0:
            _leave_start(search, case, cases.start_rows, tick)
            search.path_length_m = 0.0
            search.is_asked = case.asks_every_tick
        else:
            if tick == 1:
                take_off(search, path, case, work)
            if task != NO_TASK:
                hear(search, path, case, room, work, tick - 1, task, vector)
                task = NO_TASK
            if tick < case.n_start_rows:
                _leave_start(search, case, cases.start_rows, tick)
            else:
                _fly_tick(search, path, vehicle, case, room, tick)
            end_tick(search, path, case, room, work, tick)
        _sense(search, gauges, cases, case, i_case, room, work, tick)
        if search.is_asked or judge_inplace(search, case, room, cases.sources_m, tick):
            return


@numba.njit(cache=True, nogil=True)
def _tell(numbers, search, gauges, cases):
    i_case = search.case
    case = cases.cases[i_case]
    tell_pose_inplace(numbers, search, case, seconds_of(search.tick, case.tick_ns))
    for k in range(gauges.shape[0]):
        tell_reading_inplace(numbers, cases.instruments[i_case, k], gauges[k])


@numba.njit(cache=True, nogil=True)
def begin(rows, case_of, seed_of, cases, searches, work, observations):
    """Begin searches and go on to their first questions.

    Args:
        rows: (m,) which searches.
        case_of: (m,) the case of each.
        seed_of: (m,) the seed of each.
        cases: `Cases`.
        searches: `Searches`.
        work: `Work` of this thread.
        observations: (n, n_numbers) float32; the rows of these searches are written.

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    for n in range(len(rows)):
        i = rows[n]
        search, path, gauges = searches.searches[i], searches.paths[i], searches.gauges[i]
        case = cases.cases[case_of[n]]
        search.case, search.seed = case_of[n], seed_of[n]
        search.position_m[:] = case.start_m
        search.velocity_m_s[:] = 0.0
        search.path_length_m = 0.0
        search.phase = ON_GROUND
        search.has_leg = search.has_target = search.keeps_velocity = search.is_preparing = 0
        search.hold_until_tick = search.prepares_since_tick = 0
        search.notice = 0
        search.goal = search.kept_task = NO_TASK
        search.outcome = SEARCHES_ON
        search.command_tick = -1
        search.n_commands = search.scored_n_commands = 0
        search.scored_distance_m = case.first_distance_m
        search.scored_path_length_m = 0.0
        search.found_sources = 0
        path.start_tick = 0
        path.duration_s = 0.0
        path.coefficients[:] = 0.0
        path.end_velocity_world_m_s[:] = 0.0
        path.integral_m_s2[:] = 0.0
        for axis in range(3):
            path.coefficients[axis, 0] = case.start_m[axis]
            path.end_world_m[axis] = case.start_m[axis]
        for k in range(gauges.shape[0]):
            instrument, gauge = cases.instruments[search.case, k], gauges[k]
            name = cases.names[instrument.first_name : instrument.first_name + instrument.n_name]
            seed_inplace(gauge.stream, search.seed, name)
            gauge.has_begun = 0
            gauge.is_warming_up = 0
        _go_on(search, path, gauges, cases, work, -1, NO_TASK, work.states[2, 0])
        _tell(observations[i], search, gauges, cases)


@numba.njit(cache=True, nogil=True)
def step(rows, tasks, vectors, cases, searches, work, observations):
    """Give searches that are asked a task, and go on to their next questions or ends.

    Args:
        rows: (m,) which searches.
        tasks: (n,) CRUISE, GO_TO or HOLD for each search.
        vectors: (n, 3) velocity [m/s] or place [m], world frame.
        cases: `Cases`.
        searches: `Searches`.
        work: `Work` of this thread.
        observations: (n, n_numbers) float32; the rows of these searches are written.

    Returns:
        How many ticks were flown.

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    n_ticks = 0
    for n in range(len(rows)):
        i = rows[n]
        search, path, gauges = searches.searches[i], searches.paths[i], searches.gauges[i]
        case = cases.cases[search.case]
        tick = search.tick
        if not judge_inplace(search, case, cases.rooms[case.room], cases.sources_m, tick):
            search.command_tick = tick + 1
            _go_on(search, path, gauges, cases, work, tick, tasks[i], vectors[i])
        n_ticks += search.tick - tick
        _tell(observations[i], search, gauges, cases)
    return n_ticks


def new_work(n_places: int, state_dtype: np.dtype[Any]) -> Work:
    """Return the scratch of a thread.

    Args:
        n_places: Places that are sampled for a vehicle.
        state_dtype: `records.STATE`.
    """
    return Work(
        states=np.zeros((3, 3, 3)),
        paths=np.zeros(2, state_dtype),
        ppm=np.zeros((n_places, MOST_GASES)),
        wind_m_s=np.zeros((n_places, 3)),
        raw=np.zeros(3),
    )
