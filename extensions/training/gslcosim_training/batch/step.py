# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Step of a batch: vehicle, gas, sensors and referee, tick by tick, each search from question to question."""

import math

import numpy as np

from gslcosim.base.scalar_kernels import norm3
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim_services.referee.agent_evaluation import find_failure, is_inside, is_time_over
from gslcosim_services.referee.metrics import source_distance_m
from gslcosim_services.referee.success import is_every_source_found, is_source_reached, note_source
from gslcosim_services.world.simulation_loop import path_force_inplace, path_time_s
from gslcosim_services.world.vehicle_records import CONSTANTS
from gslcosim_training.batch.autopilot import end_tick, fly_lagged_tick, receive_task, take_off
from gslcosim_training.batch.batch_records import (
    BEGIN,
    CASE,
    COLLISION,
    FINISH,
    FRAME,
    FRAMES,
    INSTRUMENT,
    LAGGED,
    MEANDERING_PLUMES,
    MOST_GASES,
    N_START_NUMBERS,
    NEAREST_SOURCE,
    NO_TASK,
    ON_GROUND,
    OUT_OF_BOUNDS,
    RIGID_BODY,
    ROOM,
    SEARCHES_ON,
    START_INTEGRAL,
    START_QUATERNION,
    START_RATES,
    START_ROTORS,
    START_TOUCHES,
    STEADY_PLUMES,
    STEP,
    SUCCESS,
    TAPE,
    TIME_LIMIT,
)
from gslcosim_training.batch.contact_scene import advance_point_inplace
from gslcosim_training.batch.free_space import (
    array_at,
    copy_inplace,
    touches,
    wind_at_inplace,
)
from gslcosim_training.batch.gas_readings import (
    add_frame_inplace,
    add_tape_inplace,
    begin_paths_inplace,
    meandering_ppm,
)
from gslcosim_training.batch.plume_kernels import PLUME_RECORD, steady_ppm
from gslcosim_training.batch.reference_free_kernels import reference_free_njit
from gslcosim_training.batch.rigid_body import fly_rigid_tick, turn_sensors_inplace
from gslcosim_training.batch.sensors import (
    read_inplace,
    switch_on_inplace,
    write_pose_inplace,
    write_reading_inplace,
)

# Failures of `FAILURES`, of which the agent's own cannot be in a batch.
_OUTCOME_OF_FAILURE = (SEARCHES_ON, SEARCHES_ON, COLLISION, OUT_OF_BOUNDS)


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
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    if search.command_tick == tick:
        search.n_commands += 1
    nearest_m, found = math.inf, search.found_sources
    for i in range(case.n_sources):
        distance_m = source_distance_m(search.position_m, sources_m[case.first_source + i], case.is_horizontal != 0)
        nearest_m = min(nearest_m, distance_m)
        found = note_source(found, i, distance_m, case.within_m)
    search.scored_distance_m = nearest_m
    copy_inplace(search.scored_place_m, search.position_m)
    search.scored_path_length_m = search.path_length_m
    search.scored_n_commands = search.n_commands
    is_in_room = is_inside(search.position_m, room.origin_m, room.max_m)
    is_failed = False
    failure = find_failure(is_failed, search.is_touching != 0, case.ends_on_collision != 0, is_in_room)
    search.outcome = _OUTCOME_OF_FAILURE[failure]
    if failure == 0:
        search.found_sources = found
        if case.criterion == NEAREST_SOURCE:
            is_met = is_source_reached(nearest_m, case.within_m)
        else:
            is_met = is_every_source_found(found, case.n_sources)
        if is_met:
            search.outcome = SUCCESS
    if search.outcome == SEARCHES_ON and is_time_over(tick, case.tick_ns, case.time_limit_s):
        search.outcome = TIME_LIMIT
    return search.outcome != SEARCHES_ON


@reference_free_njit()
def _fly_tick(search, path, vehicle, case, room, tick, first):
    # A point robot is a mass that its force moves.
    # Returns false at the first step in which it touches something.
    p, v, a = search.position_m, search.velocity_m_s, search.acceleration_m_s2
    dt_s, step_s = case.tick_s / case.n_substeps, case.physics_step_s
    for i_substep in range(first, case.n_substeps):
        if touches(room, case.radius_m, p):
            search.touched_at = i_substep
            return False
        t_s = path_time_s(path, tick, case.tick_s, i_substep, dt_s)
        a[0], a[1], f_z, _, _, _ = path_force_inplace(vehicle, path, p, v, t_s, dt_s)
        a[2] = f_z - vehicle.gravity_m_s2
        advance_point_inplace(p, v, a[0], a[1], a[2], step_s)
    return True


@reference_free_njit()
def _leave_start(search, path, case, start_rows, tick):
    row = start_rows[case.first_start_row + tick]
    for axis in range(3):
        search.position_m[axis] = row[axis]
        search.velocity_m_s[axis] = row[3 + axis]
    search.is_touching = row[START_TOUCHES] != 0.0
    search.is_bumped = row[START_TOUCHES + 1] != 0.0
    if case.dynamics == RIGID_BODY:
        copy_inplace(search.quaternion_wxyz, row[START_QUATERNION:START_RATES])
        copy_inplace(search.rates_rad_s, row[START_RATES:START_ROTORS])
        copy_inplace(path.rotor_speed_rad_s, row[START_ROTORS:START_INTEGRAL])
        copy_inplace(path.integral_m_s2, row[START_INTEGRAL:])


@reference_free_njit()
def _note_path(search):
    p, q = search.position_m, search.tick_start_m
    search.path_length_m += norm3(p[0] - q[0], p[1] - q[1], p[2] - q[2])


# Upright, and without turning, but for a rigid body.
@reference_free_njit()
def _place_sensors(search, case, places_m, work):
    p, v = search.position_m, search.velocity_m_s
    world_m = array_at(work.places_m, (work.n_places, 3), np.float64)
    velocity_m_s = array_at(work.velocity_m_s, (work.n_places, 3), np.float64)
    for n in range(places_m.shape[0]):
        for axis in range(3):
            world_m[n, axis] = p[axis] + places_m[n, axis]
            velocity_m_s[n, axis] = v[axis]
    work.rotation[:] = 0.0
    work.rotation[0] = work.rotation[4] = work.rotation[8] = 1.0
    if case.dynamics == RIGID_BODY:
        turn_sensors_inplace(search, places_m, world_m, velocity_m_s, work.rotation)


@reference_free_njit()
def _sample_gas(cases, case, room, wanders, memory, work, tick, n, place_m):
    x_m, y_m, z_m = place_m[0], place_m[1], place_m[2]
    ppm = array_at(work.ppm, (work.n_places, MOST_GASES), np.float64)[n]
    for g in range(case.n_gases):
        ppm[g] = 0.0
    first, end = case.first_plume, case.first_plume + case.n_plumes
    if case.gas == STEADY_PLUMES:
        plumes = array_at(cases.plumes, cases.n_plumes, PLUME_RECORD)
        for k in range(first, end):
            ppm[plumes[k].gas] += steady_ppm(plumes[k], x_m, y_m, z_m)
    elif case.gas == MEANDERING_PLUMES:
        plumes = array_at(cases.plumes, cases.n_plumes, PLUME_RECORD)
        for k in range(case.n_plumes):
            plume = plumes[first + k]
            ppm[plume.gas] += meandering_ppm(plume, k, wanders, memory, case, tick, x_m, y_m, z_m)
    elif case.gas == FRAMES:
        updates = array_at(cases.frame_of_update, cases.n_frame_of_update, np.int64)
        update = min(tick // case.gas_ticks_per_step, case.n_updates - 1)
        i_frame = updates[case.first_update + update]
        if i_frame >= 0:
            frame = array_at(cases.frames, cases.n_frames, FRAME)[i_frame]
            point_m = array_at(work.places_m + 24 * n, (1, 3), np.float64)
            released_ppm = array_at(work.ppm + 8 * MOST_GASES * n, (1, frame.n_gases), np.float64)
            add_frame_inplace(frame, room, point_m, case.cutoff_sigma, work, released_ppm)
    else:
        tape = array_at(cases.tapes, cases.n_tapes, TAPE)[case.tape]
        strengths = array_at(cases.strengths, cases.n_strengths, np.float64)
        gas_of_source = array_at(cases.gas_of_source, cases.n_strengths, np.int64)
        frame = min(tick // case.gas_ticks_per_step, tape.n_frames - 1)
        add_tape_inplace(
            tape, frame, room, x_m, y_m, z_m, case.cutoff_sigma, strengths[first:end],
            gas_of_source[first:end], work, ppm,
        )  # fmt: skip


@reference_free_njit()
def _judge_and_sense(search, gauges, memory, wanders, cases, case, i_case, room, work, tick):
    # The end of a tick; returns whether the agent sees it. It is judged first: ranges that nobody sees are left out.
    sources_m = array_at(cases.sources_m, (cases.n_sources, 3), np.float64)
    is_shown = search.is_asked != 0 or judge_inplace(search, case, room, sources_m, tick)
    time_s = case.warm_up_s + seconds_from_ticks(tick, case.tick_ns)
    places_m = array_at(work.places_m, (work.n_places, 3), np.float64)
    wind_m_s = array_at(work.wind_m_s, (work.n_places, 3), np.float64)
    for n in range(case.n_sampled):
        place_m = places_m[n]
        _sample_gas(cases, case, room, wanders, memory, work, tick, n, place_m)
        wind_at_inplace(wind_m_s[n], room, time_s, place_m[0], place_m[1], place_m[2])
    instruments = array_at(cases.instruments, (cases.n_cases, cases.n_sensors), INSTRUMENT)
    for k in range(gauges.shape[0]):
        instrument = instruments[i_case, k]
        read_inplace(instrument, gauges[k], memory, search, room, tick, case.tick_s, case.n_gases, work, is_shown)
    return is_shown


@reference_free_njit()
def _go_on(search, path, gauges, memory, wanders, cases, work, tick, task, vector):
    # From the end of a tick, which is judged, to the next question, the end, or the first touch.
    i_case = search.case
    case = array_at(cases.cases, cases.n_cases, CASE)[i_case]
    vehicle = array_at(cases.vehicles, cases.n_cases, CONSTANTS)[i_case]
    room = array_at(cases.rooms, cases.n_rooms, ROOM)[case.room]
    start_rows = array_at(cases.start_rows, (cases.n_start_rows, N_START_NUMBERS), np.float64)
    places_m = array_at(cases.places_m, (cases.n_cases, cases.n_places, 3), np.float64)[i_case]
    while True:
        tick += 1
        search.tick = tick
        search.is_touching = search.is_bumped = 0
        copy_inplace(search.tick_start_m, search.position_m)
        begin_s = case.warm_up_s + seconds_from_ticks(tick - 1, case.tick_ns)
        if tick == 0:
            _leave_start(search, path, case, start_rows, tick)
            search.is_asked = case.asks_every_tick
        else:
            if tick == 1:
                take_off(search, path, case, work)
            if task != NO_TASK:
                receive_task(search, path, case, room, work, tick - 1, task, vector)
                task = NO_TASK
            if tick < case.n_start_rows:
                _leave_start(search, path, case, start_rows, tick)
            elif case.dynamics == LAGGED:
                fly_lagged_tick(search, path, vehicle, case, room, work, tick, begin_s)
            elif case.dynamics == RIGID_BODY:
                if not fly_rigid_tick(search, path, vehicle, case, room, work, tick, begin_s):
                    return
            elif not _fly_tick(search, path, vehicle, case, room, tick, 0):
                return
            _note_path(search)
            end_tick(search, path, case, room, work, tick)
        _place_sensors(search, case, places_m, work)
        if _judge_and_sense(search, gauges, memory, wanders, cases, case, i_case, room, work, tick):
            return


@reference_free_njit()
def _write_observation(numbers, search, gauges, memory, cases, work):
    i_case = search.case
    case = array_at(cases.cases, cases.n_cases, CASE)[i_case]
    instruments = array_at(cases.instruments, (cases.n_cases, cases.n_sensors), INSTRUMENT)
    write_pose_inplace(numbers, search, case, seconds_from_ticks(search.tick, case.tick_ns))
    for k in range(gauges.shape[0]):
        write_reading_inplace(numbers, instruments[i_case, k], gauges[k], memory, search, work)


@reference_free_njit()
def _reset(search, path, gauges, memory, wanders, cases, i_case, seed):
    case = array_at(cases.cases, cases.n_cases, CASE)[i_case]
    gravity_m_s2 = array_at(cases.vehicles, cases.n_cases, CONSTANTS)[i_case].gravity_m_s2
    instruments = array_at(cases.instruments, (cases.n_cases, cases.n_sensors), INSTRUMENT)
    names = array_at(cases.names, cases.n_names, np.uint8)
    search.case, search.seed = i_case, seed
    search.tick = -1
    copy_inplace(search.position_m, case.start_m)
    search.velocity_m_s[:] = 0.0
    search.quaternion_wxyz[:] = 0.0
    search.quaternion_wxyz[0] = 1.0
    search.rates_rad_s[:] = 0.0
    search.acceleration_m_s2[:] = 0.0
    search.force_m_s2[:] = 0.0
    search.force_m_s2[2] = gravity_m_s2
    search.yaw_sin, search.yaw_cos = 0.0, 1.0
    search.touched_at = -1
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
    copy_inplace(search.scored_place_m, case.first_place_m)
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
    if case.gas == MEANDERING_PLUMES:
        begin_paths_inplace(wanders, memory, case, names, seed)
    for k in range(gauges.shape[0]):
        instrument, gauge = instruments[i_case, k], gauges[k]
        name = names[instrument.first_name : instrument.first_name + instrument.n_name]
        switch_on_inplace(instrument, gauge, memory, name, seed)


@reference_free_njit()
def fly(rows, how, case_of, seed_of, tasks, vectors, touch, all_cases, searches, works, observations):
    """Fly searches to their next questions or ends, or to where they touch something.

    BEGIN begins them again, in a case and with a seed; STEP gives those that are asked a task; FINISH ends the tick in
    which one has touched something, when its pose and motion are those of the tick's end, and goes on.

    Args:
        rows: (m,) which searches; one with FINISH.
        how: BEGIN, STEP or FINISH.
        case_of: (n,) the case that each search begins.
        seed_of: (n,) the seed of each.
        tasks: (n,) CRUISE, GO_TO or HOLD for each search.
        vectors: (n, 3) velocity [m/s] or place [m], world frame.
        touch: `batch_records.TouchState`; it counts with FINISH.
        all_cases: (1,) record of `CASES`.
        searches: `batch_records.Searches`.
        works: (1,) record of `WORK` of this thread.
        observations: (n, n_numbers) float32; the rows of these searches are written.

    Returns:
        How many have stopped within a tick, since they touch something: their `touched_at` is not -1.

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    n_touched, cases, work = 0, all_cases[0], works[0]
    sources_m = array_at(cases.sources_m, (cases.n_sources, 3), np.float64)
    places_m = array_at(work.places_m, (work.n_places, 3), np.float64)
    velocity_m_s = array_at(work.velocity_m_s, (work.n_places, 3), np.float64)
    for n in range(len(rows)):
        i = rows[n]
        search, path, gauges, memory = searches.searches[i], searches.paths[i], searches.gauges[i], searches.memory[i]
        wanders = searches.wanders[i]
        if how == BEGIN:
            _reset(search, path, gauges, memory, wanders, cases, case_of[i], seed_of[i])
        i_case = search.case
        case = array_at(cases.cases, cases.n_cases, CASE)[i_case]
        room, tick = array_at(cases.rooms, cases.n_rooms, ROOM)[case.room], search.tick
        task, goes_on = NO_TASK, True
        if how == STEP:
            task = tasks[i]
            search.is_asked = 0
            goes_on = not judge_inplace(search, case, room, sources_m, tick)
        elif how == FINISH:
            search.touched_at = -1
            search.is_touching = search.is_bumped = touch.is_touched[0]
            _note_path(search)
            end_tick(search, path, case, room, work, tick)
            copy_inplace(work.rotation, touch.rotation)
            for k in range(work.n_places):
                copy_inplace(places_m[k], touch.places_m[k])
                copy_inplace(velocity_m_s[k], touch.velocity_m_s[k])
            goes_on = not _judge_and_sense(search, gauges, memory, wanders, cases, case, i_case, room, work, tick)
        if goes_on:
            if how == STEP:
                search.command_tick = tick + 1
            _go_on(search, path, gauges, memory, wanders, cases, work, tick, task, vectors[i])
        _write_observation(observations[i], search, gauges, memory, cases, work)
        n_touched += search.touched_at >= 0
    return n_touched
