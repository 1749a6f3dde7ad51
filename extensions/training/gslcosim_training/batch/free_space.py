# pyright: basic, reportCallIssue=false
"""Free space of a search: exact distances, where a vehicle may be, what it touches, and when it must brake."""

# ruff: noqa: ANN001, ANN201, ANN202 - kernels have no types, and symbols of equations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.environment.grid_kernels import trilinear_wind
from gslcosim_services.fields.filament.filament_step import cell_index
from gslcosim_services.fields.mixing_ratio import Walls, is_box_of_air
from gslcosim_services.world.flight_space import (
    CLEARANCE_M,
    NO_AXIS,
    find_axis_of_stop_beyond,
    find_axis_out_of_bounds,
    nearest_cell_index,
)
from gslcosim_services.world.multirotor_control import rotation_from_quaternion
from gslcosim_services.world.trajectory import (
    DURATION_GROWTH,
    MIN_DURATION_S,
    is_path_over,
    plan_quickest_inplace,
    polynomial_at,
    write_polynomial_state_inplace,
)
from gslcosim_services.world.vehicle_records import STATE
from gslcosim_training.batch.reference_free_kernels import reference_free_njit

_SOLID = 1
# What rounding may move a place by.
_ROUNDING_M = 1e-6
_TO_VELOCITY = True
# What rounding may add, and a stop that no search looks at.
_HAIR = 1.0 + 1e-9
_FAR_TOO_LONG_S = 1000.0


@intrinsic
def array_at(typingctx: Any, address: Any, shape: Any, dtype: Any) -> Any:
    """Return the C-contiguous array of a shape and a dtype that begins at an address.

    It is numba's `carray`, which may not be used where no references are counted.
    """
    is_tuple = isinstance(shape, types.BaseTuple)
    array_type = types.Array(dtype.dtype, len(shape) if is_tuple else 1, "C")
    signature = array_type(address, shape, dtype)

    def codegen(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        given_types = signature.args[1] if is_tuple else (signature.args[1],)
        given: Any = cgutils.unpack_tuple(builder, arguments[1]) if is_tuple else (arguments[1],)
        lengths = [context.cast(builder, n, n_type, types.intp) for n, n_type in zip(given, given_types, strict=True)]
        data_type = context.get_data_type(array_type.dtype)
        item_size = context.get_abi_sizeof(data_type)
        strides: list[Any] = [cgutils.intp_t(item_size)]
        for length in reversed(lengths[1:]):
            strides.insert(0, builder.mul(strides[0], length))
        array: Any = make_array(array_type)(context, builder)
        data = builder.inttoptr(arguments[0], ir.PointerType())
        populate_array(array, data=data, shape=lengths, strides=strides, itemsize=item_size, meminfo=None)
        return array._getvalue()

    return signature, codegen


@reference_free_njit()
def copy_inplace(to, values):
    """Copy numbers one by one: kernels of the batch count no references, so numba may make no arrays in them."""
    for k in range(len(to)):
        to[k] = values[k]


@reference_free_njit()
def _is_solid_at(room, place_m):
    nx, ny, nz = room.shape[0], room.shape[1], room.shape[2]
    i = nearest_cell_index(place_m[0], room.origin_m[0], room.cell_m, nx)
    j = nearest_cell_index(place_m[1], room.origin_m[1], room.cell_m, ny)
    k = nearest_cell_index(place_m[2], room.origin_m[2], room.cell_m, nz)
    occupancy = array_at(room.occupancy, (nx, ny, nz), np.uint8)
    return occupancy[i, j, k] == _SOLID


@reference_free_njit()
def is_place_refused(room, radius_m, place_m):
    """Return True if a vehicle cannot be sent to a place; see `FlightSpace.refusal`.

    Args:
        room: Record of `ROOM`.
        radius_m: The vehicle's radius [m].
        place_m: (3,) place, world frame [m].

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    if find_axis_out_of_bounds(place_m, room.origin_m, room.max_m, radius_m) != NO_AXIS:
        return True
    return _is_solid_at(room, place_m)


@reference_free_njit()
def is_edge_ahead(room, radius_m, stop_m, velocity_m_s):
    """Return True if a vehicle that would stop at a place must brake now; see `FlightSpace.find_edge_ahead`.

    Args:
        room: Record of `ROOM`.
        radius_m: The vehicle's radius [m].
        stop_m: (3,) where it would come to rest, world frame [m].
        velocity_m_s: (3,) how it moves now, world frame [m/s].

    Held by:
        extensions/training/tests/integration/test_batch_equals_flight.py
    """
    if find_axis_of_stop_beyond(stop_m, velocity_m_s, room.origin_m, room.max_m, radius_m) != NO_AXIS:
        return True
    moves = velocity_m_s[0] != 0.0 or velocity_m_s[1] != 0.0 or velocity_m_s[2] != 0.0
    return moves and _is_solid_at(room, stop_m)


@reference_free_njit()
def is_open_ahead(room, radius_m, state, longest_s):
    """Return True if `is_edge_ahead` is false wherever a vehicle stops that takes no longer than a time to it.

    The way to a stop after T is T v/2 + T^2 a/12, see `set_quartic_to_velocity_inplace`.

    Args:
        room: Record of `ROOM`.
        radius_m: The vehicle's radius [m].
        state: (3, 3) rows place [m], velocity [m/s], acceleration [m/s^2], world frame.
        longest_s: How long it takes at most [s].

    Held by:
        extensions/training/tests/unit/batch/test_braking.py
    """
    x0, x1 = _stops_between(state, 0, longest_s)
    y0, y1 = _stops_between(state, 1, longest_s)
    z0, z1 = _stops_between(state, 2, longest_s)
    keeps_m = radius_m + CLEARANCE_M
    low, high = room.origin_m, room.max_m
    if x0 < low[0] + keeps_m or y0 < low[1] + keeps_m or z0 < low[2] + keeps_m:
        return False
    if x1 > high[0] - keeps_m or y1 > high[1] - keeps_m or z1 > high[2] - keeps_m:
        return False
    return is_box_of_air(walls_of(room), x0, x1, y0, y1, z0, z1)


@reference_free_njit()
def walls_of(room):
    """Return the `Walls` of a record of `ROOM`, which hide gas."""
    nx, ny, nz = room.shape[0], room.shape[1], room.shape[2]
    is_opaque = True
    return Walls(
        is_opaque,
        array_at(room.occupancy, (nx, ny, nz), np.uint8),
        array_at(room.solid_sums, (nx + 1, ny + 1, nz + 1), np.int32),
        (room.origin_m[0], room.origin_m[1], room.origin_m[2]),
        room.cell_m,
    )


@reference_free_njit()
def _stops_between(state, axis, longest_s):
    place_m = state[0, axis]
    by_speed = longest_s * state[1, axis] * 0.5
    by_force = longest_s * longest_s * state[2, axis] / 12.0
    low, high = min(by_speed, 0.0) + min(by_force, 0.0), max(by_speed, 0.0) + max(by_force, 0.0)
    return place_m + low - _ROUNDING_M, place_m + high + _ROUNDING_M


@reference_free_njit()
def touches(room, radius_m, position_m):
    """Return True if a ball touches one of the room's boxes.

    Args:
        room: Record of `ROOM`.
        radius_m: Of the ball [m].
        position_m: (3,) its centre, world frame [m].
    """
    begin, end = _near_boxes(room, position_m)
    if begin == end:
        return False
    for n in range(begin, end):
        x_m, y_m, z_m = _gaps_m(room, n, position_m)
        if x_m * x_m + y_m * y_m + z_m * z_m < radius_m * radius_m:
            return True
    return False


@reference_free_njit()
def is_hit(room, radius_m, half_height_m, position_m):
    """Return True if an upright disc is in one of the room's boxes.

    Args:
        room: Record of `ROOM`, for vehicles of no smaller radius.
        radius_m: Of the disc [m].
        half_height_m: Of the disc, no more than its radius [m].
        position_m: (3,) its centre, world frame [m].
    """
    begin, end = _near_boxes(room, position_m)
    for n in range(begin, end):
        x_m, y_m, z_m = _gaps_m(room, n, position_m)
        if z_m < half_height_m and x_m * x_m + y_m * y_m < radius_m * radius_m:
            return True
    return False


@reference_free_njit()
def may_touch(room, half_m, pose):
    """Return True if a turned box reaches into one of the room's boxes, or no more than the upright box around it does.

    Args:
        room: Record of `ROOM`, for vehicles of no smaller reach.
        half_m: (3,) half sizes of the box, body frame [m].
        pose: (7,) its centre, world frame [m], and its quaternion wxyz.
    """
    begin, end = _near_boxes(room, pose)
    if begin == end:
        return False
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_from_quaternion(pose[3], pose[4], pose[5], pose[6])
    a, b, c = half_m[0], half_m[1], half_m[2]
    along_x_m = abs(r00) * a + abs(r01) * b + abs(r02) * c + _ROUNDING_M
    along_y_m = abs(r10) * a + abs(r11) * b + abs(r12) * c + _ROUNDING_M
    along_z_m = abs(r20) * a + abs(r21) * b + abs(r22) * c + _ROUNDING_M
    for n in range(begin, end):
        x_m, y_m, z_m = _gaps_m(room, n, pose)
        if x_m < along_x_m and y_m < along_y_m and z_m < along_z_m:
            return True
    return False


# Which members of the list of boxes may be near.
@reference_free_njit()
def _near_boxes(room, position_m) -> Any:
    i = cell_index(position_m[0], room.near_origin_m[0], room.near_block_m)
    j = cell_index(position_m[1], room.near_origin_m[1], room.near_block_m)
    k = cell_index(position_m[2], room.near_origin_m[2], room.near_block_m)
    nx, ny, nz = room.near_shape[0], room.near_shape[1], room.near_shape[2]
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return 0, 0
    block = (i * ny + j) * nz + k
    first = array_at(room.near_first, nx * ny * nz + 1, np.int32)
    return first[block], first[block + 1]


# How far a place is from a box along each axis.
@reference_free_njit()
def _gaps_m(room, n, position_m) -> Any:
    members = array_at(room.near_members, n + 1, np.int32)
    boxes_m = array_at(room.boxes_m, (room.n_boxes, 6), np.float64)
    m = members[n]
    return (
        max(boxes_m[m, 0] - position_m[0], position_m[0] - boxes_m[m, 3], 0.0),
        max(boxes_m[m, 1] - position_m[1], position_m[1] - boxes_m[m, 4], 0.0),
        max(boxes_m[m, 2] - position_m[2], position_m[2] - boxes_m[m, 5], 0.0),
    )


@reference_free_njit()
def wind_address_at(room, time_s):
    """Return the address of the room's wind (nx, ny, nz, 3) [m/s] at a time since the sources opened [s]."""
    n_frames = room.wind_shape[0]
    frame = int(time_s / room.wind_period_s + 1e-9)
    frame = frame % n_frames if room.wind_loops else min(frame, n_frames - 1)
    nx, ny, nz = room.wind_shape[1], room.wind_shape[2], room.wind_shape[3]
    return room.wind + frame * nx * ny * nz * 12


@reference_free_njit()
def wind_at_inplace(wind_m_s, room, time_s, x_m, y_m, z_m):
    """Write the room's wind (3,) [m/s] at a time since the sources opened [s] and a place, world frame [m]."""
    nx, ny, nz = room.wind_shape[1], room.wind_shape[2], room.wind_shape[3]
    wind = array_at(wind_address_at(room, time_s), (nx, ny, nz, 3), np.float32)
    origin_m = (room.origin_m[0], room.origin_m[1], room.origin_m[2])
    wind_m_s[0], wind_m_s[1], wind_m_s[2] = trilinear_wind(wind, origin_m, room.cell_m, x_m, y_m, z_m)


@reference_free_njit()
def state_after_inplace(state, path, t_s):
    """Write the state of a path after a time: rows position [m], velocity [m/s], acceleration [m/s^2].

    Args:
        state: (3, 3) written.
        path: Record of `records.STATE`, of which the path counts.
        t_s: Time since its start [s].
    """
    if is_path_over(t_s, path.duration_s):
        beyond_s = max(0.0, t_s - path.duration_s)
        for axis in range(3):
            velocity = path.end_velocity_world_m_s[axis]
            state[0, axis] = path.end_world_m[axis] + beyond_s * velocity
            state[1, axis] = velocity
            state[2, axis] = 0.0
        return
    write_polynomial_state_inplace(state, path.coefficients, t_s)


@reference_free_njit()
def plan_to_velocity_inplace(path, case, start, end, u, v, w, tick):
    """Take the quickest path to a velocity.

    Args:
        path: Record of `records.STATE`; written.
        case: Record of `CASE`, with the limits.
        start: (3, 3) rows place [m], velocity [m/s], acceleration [m/s^2] at the tick's end, world frame.
        end: (3, 3) scratch, whose accelerations are 0.
        u: Velocity along world x [m/s].
        v: Velocity along world y [m/s].
        w: Velocity along world z [m/s].
        tick: The tick that ended.
    """
    end[1, 0], end[1, 1], end[1, 2] = u, v, w
    coefficients = path.coefficients
    duration_s = plan_quickest_inplace(
        coefficients, start, end, _TO_VELOCITY, case.max_speed_m_s, case.max_acceleration_m_s2, 0.0, 0.0
    )
    path.start_tick = tick
    path.duration_s = duration_s
    path.end_velocity_world_m_s[0] = u
    path.end_velocity_world_m_s[1] = v
    path.end_velocity_world_m_s[2] = w
    for axis in range(3):
        path.end_world_m[axis], _, _, _ = polynomial_at(coefficients, axis, duration_s)


@reference_free_njit()
def motion_inplace(state, path, case, tick):
    """Write the state of a path at the end of a tick; see `state_after_inplace`."""
    state_after_inplace(state, path, seconds_from_ticks(tick - path.start_tick, case.tick_ns))


@reference_free_njit()
def longest_stop_s(case, velocity_m_s, acceleration_m_s2):
    """Return a time [s] that the quickest stop does not take longer than; infinity where that is not seen at once.

    v(s) = (1 - s)^2 ((1 + 2 s) v + s a T),  s = t/T
    [m/s]

    Its acceleration is at most the greatest of |a|, 2 |v|/T, and 1.5 |v|/T + |a|/3. It is never faster than
    |v| + 4/27 |a| T, nor than |v| where a does not point along v and |a| T < sqrt(6) |v|. So a duration is known to be
    feasible without a look at the polynomial, and the search for the quickest, in steps of 4 %, ends there at the
    latest.

    Args:
        case: Record of `CASE`, with the limits.
        velocity_m_s: (3,) v, world frame [m/s].
        acceleration_m_s2: (3,) a, world frame [m/s^2].

    Source:
        `set_quartic_to_velocity_inplace`, to rest.
    Held by:
        extensions/training/tests/unit/batch/test_braking.py
    """
    v, a = velocity_m_s, acceleration_m_s2
    speed = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    size = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    at_rest_s = 1.5 * speed / case.max_acceleration_m_s2
    if size == 0.0:
        return _HAIR * max(MIN_DURATION_S, at_rest_s)
    most = max(case.max_acceleration_m_s2, size)
    feasible_s = max(2.0 * speed / most, 1.5 * speed / (most - size / 3.0))
    longest_s = _HAIR * max(MIN_DURATION_S, 0.3 * at_rest_s, DURATION_GROWTH * feasible_s)
    if speed + (4.0 / 27.0) * size * longest_s <= max(case.max_speed_m_s, speed):
        return longest_s
    slows = v[0] * a[0] + v[1] * a[1] + v[2] * a[2] <= 0.0
    return longest_s if slows and size * longest_s < 2.4 * speed else math.inf


@reference_free_njit()
def must_brake(path, case, room, work, tick):
    """Return True if a vehicle that brakes a tick later stops where it must not; see `world.obstacle_avoidance`.

    Args:
        path: Record of `records.STATE`: what it flies.
        case: Record of `CASE`.
        room: Record of `ROOM`.
        work: Record of `WORK`.
        tick: The tick that ended.

    Held by:
        extensions/training/tests/unit/batch/test_braking.py
    """
    state, end, stop = work.states[0], work.states[1], array_at(work.paths, 2, STATE)[0]
    motion_inplace(state, path, case, tick + 1)
    # Mostly there is nothing anywhere near, and no need to know where exactly it stops.
    longest_s = longest_stop_s(case, state[1], state[2])
    if longest_s < _FAR_TOO_LONG_S and is_open_ahead(room, case.radius_m, state, longest_s):
        return False
    plan_to_velocity_inplace(stop, case, state, end, 0.0, 0.0, 0.0, tick)
    return is_edge_ahead(room, case.radius_m, stop.end_world_m, state[1])
