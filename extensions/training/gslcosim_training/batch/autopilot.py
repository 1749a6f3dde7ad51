# pyright: basic, reportCallIssue=false
# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations
"""Autopilot of a point robot: obeys velocities and holds as the world's autopilot does, with a force that lags.

Paths are planned by the kernels of `gslcosim_services.world`, and so is the order in which things happen
(`task_order`); what is here is the state of a search that they change.
"""

import numpy as np

from gslcosim.base.scalar_kernels import norm3
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim_services.world.multirotor_control import drag_force
from gslcosim_services.world.path_follower import back_off_frac, has_arrived, is_stop_under_way, is_too_late
from gslcosim_services.world.simulation_loop import path_force_inplace, path_time_s
from gslcosim_services.world.task_order import (
    ACCEPT,
    ARRIVAL,
    DEFER,
    EDGE,
    PREPARATION,
    REFUSE,
    STOP,
    find_answer,
    find_deferred_answer,
    find_watch,
    is_command_due,
)
from gslcosim_services.world.trajectory import (
    deviates_too_far,
    is_beyond_limit,
    is_path_over,
    plan_quickest_inplace,
)
from gslcosim_services.world.vehicle_records import STATE
from gslcosim_training.batch.batch_records import (
    CRUISE,
    FLYING,
    GO_TO,
    HOLD,
    HOLDING,
    NO_TASK,
    TAKING_OFF,
)
from gslcosim_training.batch.contact_scene import advance_point_inplace
from gslcosim_training.batch.free_space import (
    array_at,
    copy_inplace,
    is_hit,
    is_place_refused,
    motion_inplace,
    must_brake,
    plan_to_velocity_inplace,
    wind_at_inplace,
)
from gslcosim_training.batch.reference_free_kernels import reference_free_njit

_TO_POINT = False
# Vehicles of a batch have no setpoints, do not fail, and have left the ground when they get their first task.
_NEVER = False


@reference_free_njit()
def fly_lagged_tick(search, path, vehicle, case, room, work, tick, time_s):
    """Fly a rotorcraft for a tick as a point mass that is upright.

    df/dt = j_ref + (f_wanted - f)/tau,  dv/dt = f - g + D(wind - v)/m
    [m/s^3] = [m/s^2]/[s],  [m/s^2] = [N]/[kg]

    f_wanted is what the vehicle's own control wants with its limits, and tau how long its attitude takes to give it,
    sideways, and its rotors, upwards. The wind is that at the tick's beginning. It stops where it hits something.

    Args:
        search: Record of `SEARCH`; place, velocity and force are advanced.
        path: Record of `records.STATE`; integral and heading are advanced.
        vehicle: Record of `records.CONSTANTS`.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that is advanced to.
        time_s: Time since the sources opened at the tick's beginning [s].

    Source:
        Our choice: the control of `world.physics`, whose attitude loop is much faster than its position loop.
    Deviation:
        Attitude and single rotors are left out; drag is that of an upright vehicle in hover; steps are those of point
        robots.
    Held by:
        extensions/training/tests/integration/test_batch_of_rotorcraft.py
    """
    p, v, f = search.position_m, search.velocity_m_s, search.force_m_s2
    dt_s = case.tick_s / case.n_substeps
    wind = array_at(work.wind_m_s, (work.n_places, 3), np.float64)[0]
    wind_at_inplace(wind, room, time_s, p[0], p[1], p[2])
    for i_substep in range(case.n_substeps):
        if is_hit(room, case.radius_m, case.half_height_m, p):
            search.is_touching = search.is_bumped = 1
            v[0] = v[1] = v[2] = 0.0
            return
        t_s = path_time_s(path, tick, case.tick_s, i_substep, dt_s)
        f_x, f_y, f_z, j_x, j_y, j_z = path_force_inplace(vehicle, path, p, v, t_s, dt_s)
        f[0] += j_x * dt_s + case.tilt_share * (f_x - f[0])
        f[1] += j_y * dt_s + case.tilt_share * (f_y - f[1])
        f[2] += j_z * dt_s + case.lift_share * (f_z - f[2])
        d_x, d_y, d_z = drag_force(vehicle, case.rotor_speeds_rad_s, wind[0] - v[0], wind[1] - v[1], wind[2] - v[2])
        a_x, a_y = f[0] + d_x / vehicle.mass_kg, f[1] + d_y / vehicle.mass_kg
        a_z = f[2] - vehicle.gravity_m_s2 + d_z / vehicle.mass_kg
        advance_point_inplace(p, v, a_x, a_y, a_z, dt_s)


@reference_free_njit()
def _fly_to_inplace(path, case, start, end, place_m, tick):
    # The quickest path that rests at a place.
    for axis in range(3):
        end[0, axis], end[1, axis], end[2, axis] = place_m[axis], 0.0, 0.0
    path.duration_s = plan_quickest_inplace(
        path.coefficients, start, end, _TO_POINT, case.max_speed_m_s, case.max_acceleration_m_s2, 0.0, 0.0
    )
    path.start_tick = tick
    for axis in range(3):
        path.end_world_m[axis] = place_m[axis]
        path.end_velocity_world_m_s[axis] = 0.0


@reference_free_njit()
def _forget_legs(search):
    search.has_leg = 0
    search.has_target = 0


@reference_free_njit()
def _stop(search, path, case, work, tick):
    is_stopping = is_stop_under_way(search.has_target != 0, _NEVER, path.end_velocity_world_m_s)
    _forget_legs(search)
    search.keeps_velocity = 0
    search.is_preparing = 0
    if not is_stopping:
        state, end = work.states[0], work.states[1]
        motion_inplace(state, path, case, tick)
        plan_to_velocity_inplace(path, case, state, end, 0.0, 0.0, 0.0, tick)


@reference_free_njit()
def _hold(search, path, case, work, tick, hold_ticks):
    search.goal = NO_TASK
    if search.phase == TAKING_OFF:
        return
    search.hold_until_tick = tick + hold_ticks
    _stop(search, path, case, work, tick)
    search.phase = HOLDING


@reference_free_njit()
def _begin_leg(search, path, case, work, tick, x_m, y_m, z_m, hold_ticks):
    search.has_leg = 1
    search.leg_end_m[0], search.leg_end_m[1], search.leg_end_m[2] = x_m, y_m, z_m
    search.leg_hold_ticks = hold_ticks
    _follow_leg(search, path, case, work, tick)
    search.prepares_since_tick = tick
    search.phase = FLYING


@reference_free_njit()
def _follow_leg(search, path, case, work, tick):
    if not search.is_preparing:
        search.prepares_since_tick = tick
    state, end = work.states[0], work.states[1]
    motion_inplace(state, path, case, tick)
    _fly_to_inplace(path, case, state, end, search.leg_end_m, tick)
    search.is_preparing = 0
    limit_m_s2 = case.max_acceleration_m_s2
    if deviates_too_far(path.coefficients, path.duration_s, path.end_world_m, state[1], limit_m_s2):
        # It had better stop first.
        plan_to_velocity_inplace(path, case, state, end, 0.0, 0.0, 0.0, tick)
        search.is_preparing = 1
    search.has_target = 1
    search.keeps_velocity = 0


@reference_free_njit()
def take_off(search, path, case, work):
    """Leave the start at the first tick; see `FlightStateMachine.take_off`."""
    path.is_armed = 1
    x_m, y_m = path.end_world_m[0], path.end_world_m[1]
    _begin_leg(search, path, case, work, 0, x_m, y_m, case.search_height_m, case.usual_hold_ticks)
    search.phase = TAKING_OFF
    search.notice = 0


@reference_free_njit()
def _is_equal(a, b):
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@reference_free_njit()
def _is_refused(search, path, case, room, work, tick, task, vector):
    if task == GO_TO:
        return is_place_refused(room, case.radius_m, vector)
    if task != CRUISE:
        return False
    if is_beyond_limit(norm3(vector[0], vector[1], vector[2]), case.max_speed_m_s):
        return True
    if search.phase == TAKING_OFF or (search.keeps_velocity and _is_equal(vector, search.kept_velocity_m_s)):
        return False
    planned, state, end = array_at(work.paths, 2, STATE)[1], work.states[2], work.states[1]
    motion_inplace(state, path, case, tick)
    plan_to_velocity_inplace(planned, case, state, end, vector[0], vector[1], vector[2], tick)
    return must_brake(planned, case, room, work, tick)


@reference_free_njit()
def _copy_path(to, path):
    to.start_tick = path.start_tick
    to.duration_s = path.duration_s
    for axis in range(3):
        for power in range(6):
            to.coefficients[axis, power] = path.coefficients[axis, power]
    copy_inplace(to.end_world_m, path.end_world_m)
    copy_inplace(to.end_velocity_world_m_s, path.end_velocity_world_m_s)


@reference_free_njit()
def receive_task(search, path, case, room, work, tick, task, vector):
    """Do a task of the agent, keep it for after take-off, or refuse it; see `Autopilot`.

    Args:
        search: Record of `SEARCH`.
        path: Record of `records.STATE`.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that ended.
        task: CRUISE, GO_TO or HOLD.
        vector: (3,) velocity [m/s] or place [m], world frame.
    """
    search.notice = 0
    is_said_again = case.asks_every_tick and task != HOLD and search.goal == task
    if is_said_again and _is_equal(search.goal_vector, vector):
        return
    is_refused = _is_refused(search, path, case, room, work, tick, task, vector)
    answer = find_answer(is_refused, task == HOLD, search.phase == TAKING_OFF, _NEVER)
    if answer == REFUSE:
        search.notice = 1
        search.kept_task = NO_TASK
        _hold(search, path, case, work, tick, case.usual_hold_ticks)
    elif answer == STOP:
        search.kept_task = NO_TASK
        _hold(search, path, case, work, tick, case.hold_ticks)
    elif answer == DEFER:
        search.kept_task = task
        copy_inplace(search.kept_vector, vector)
    else:
        search.goal = task
        copy_inplace(search.goal_vector, vector)
        if task == GO_TO:
            _begin_leg(search, path, case, work, tick, vector[0], vector[1], vector[2], case.hold_ticks)
        else:
            if not (search.keeps_velocity and _is_equal(vector, search.kept_velocity_m_s)) or search.is_preparing:
                # It was planned to see whether it can be done.
                _copy_path(path, array_at(work.paths, 2, STATE)[1])
                search.is_preparing = 0
                search.prepares_since_tick = tick
            _forget_legs(search)
            search.keeps_velocity = 1
            copy_inplace(search.kept_velocity_m_s, vector)
            search.hold_until_tick = tick + case.hold_ticks
            search.phase = FLYING


@reference_free_njit()
def _is_over(path, case, tick):
    return is_path_over(seconds_from_ticks(tick - path.start_tick, case.tick_ns), path.duration_s)


@reference_free_njit()
def _arrive(search, tick):
    search.phase = HOLDING
    search.hold_until_tick = tick + (search.leg_hold_ticks if search.has_leg else 0)
    search.has_leg = 0


@reference_free_njit()
def _notice_arrival(search, path, case, room, tick):
    if not _is_over(path, case, tick):
        return
    p, v, end = search.position_m, search.velocity_m_s, path.end_world_m
    distance_m = norm3(p[0] - end[0], p[1] - end[1], p[2] - end[2])
    if has_arrived(distance_m, norm3(v[0], v[1], v[2])):
        _arrive(search, tick)
    elif is_too_late(seconds_from_ticks(tick - path.start_tick, case.tick_ns) - path.duration_s):
        _give_up(search, path, case, room, tick, distance_m)


# See `back_off`: it rests a little back from where it got stuck.
@reference_free_njit()
def _give_up(search, path, case, room, tick, distance_m):
    p, end = search.position_m, path.end_world_m
    back = back_off_frac(distance_m)
    x_m, y_m, z_m = p[0] + back * (p[0] - end[0]), p[1] + back * (p[1] - end[1]), p[2] + back * (p[2] - end[2])
    end[0], end[1], end[2] = x_m, y_m, z_m
    if is_place_refused(room, case.radius_m, end):
        copy_inplace(end, p)
    path.start_tick = tick
    path.duration_s = 0.0
    path.coefficients[:] = 0.0
    path.end_velocity_world_m_s[:] = 0.0
    path.integral_m_s2[:] = 0.0
    path.coefficients[0, 0], path.coefficients[1, 0], path.coefficients[2, 0] = end[0], end[1], end[2]
    search.keeps_velocity = 0
    search.is_preparing = 0
    search.notice = 1
    _arrive(search, tick)


@reference_free_njit()
def end_tick(search, path, case, room, work, tick):
    """Notice arrivals and edges, begin a task that was kept, and decide whether the agent is asked; see `Autopilot`.

    Args:
        search: Record of `SEARCH`, with the true position and velocity at the end of the tick.
        path: Record of `records.STATE`.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that ends.
    """
    goes_to_place = search.phase == TAKING_OFF or search.phase == FLYING
    watch = find_watch(search.is_preparing != 0, search.keeps_velocity != 0, goes_to_place)
    if watch == PREPARATION:
        if _is_over(path, case, tick):
            _follow_leg(search, path, case, work, tick)
    elif watch == EDGE:
        if must_brake(path, case, room, work, tick):
            _hold(search, path, case, work, tick, case.usual_hold_ticks)
            search.notice = 1
    elif watch == ARRIVAL:
        _notice_arrival(search, path, case, room, tick)
    if search.kept_task != NO_TASK:
        task, answer = search.kept_task, find_deferred_answer(search.phase == TAKING_OFF, search.phase == HOLDING)
        if answer != DEFER:
            search.kept_task = NO_TASK
        if answer == ACCEPT:
            receive_task(search, path, case, room, work, tick, task, search.kept_vector)
    search.is_asked = is_command_due(
        case.asks_every_tick != 0, _NEVER, search.phase == HOLDING, search.keeps_velocity != 0, tick,
        search.hold_until_tick,
    )  # fmt: skip
