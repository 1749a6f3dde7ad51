"""Where a vehicle may be in a room, and what it touches."""
# pyright: basic, reportCallIssue=false

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from gslcosim.environment.wind_kernels import trilinear_wind
from gslcosim.training.batch.reference_free_kernels import reference_free_njit

_SOLID = 1
# What a vehicle may stray from its reference while it brakes; see `gslcosim.world.paths.space`.
_CLEARANCE_M = 0.1
# What rounding may move a place by.
_ROUNDING_M = 1e-6
# What floors and walls give way; see `gslcosim.referee.case`.
_GIVES_WAY_M = 0.05


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
def _cell(coordinate_m, origin_m, cell_m):
    return math.floor((coordinate_m - origin_m) / cell_m)


@reference_free_njit()
def _is_solid_at(room, x_m, y_m, z_m, least):
    # The cell that holds a place, or the nearest of the grid: above it always, below it where `least` is 0.
    nx, ny, nz = room.shape[0], room.shape[1], room.shape[2]
    i = max(min(_cell(x_m, room.origin_m[0], room.cell_m), nx - 1), least)
    j = max(min(_cell(y_m, room.origin_m[1], room.cell_m), ny - 1), least)
    k = max(min(_cell(z_m, room.origin_m[2], room.cell_m), nz - 1), least)
    occupancy = array_at(room.occupancy, (nx, ny, nz), np.uint8)
    return occupancy[i, j, k] == _SOLID


@reference_free_njit()
def is_place_refused(room, radius_m, x_m, y_m, z_m):
    """Return whether a vehicle cannot be sent to a place; see `FlightSpace.refusal`.

    Args:
        room: Record of `ROOM`.
        radius_m: The vehicle's radius [m].
        x_m: Place, world frame [m].
        y_m: Place, world frame [m].
        z_m: Place, world frame [m].

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    low, high = room.origin_m, room.max_m
    if not (low[0] <= x_m <= high[0] and low[1] <= y_m <= high[1]):
        return True
    if not (low[2] + radius_m <= z_m <= high[2] - radius_m):
        return True
    return _is_solid_at(room, x_m, y_m, z_m, 0)


@reference_free_njit()
def is_edge_ahead(room, radius_m, stop_m, velocity_m_s):
    """Return whether a vehicle that would stop at a place must brake now; see `FlightSpace.edge_ahead`.

    Args:
        room: Record of `ROOM`.
        radius_m: The vehicle's radius [m].
        stop_m: (3,) where it would come to rest, world frame [m].
        velocity_m_s: (3,) how it moves now, world frame [m/s].

    Held by:
        tests/integration/training/test_batch_equals_flight.py
    """
    for axis in range(3):
        least = room.origin_m[axis] + radius_m + _CLEARANCE_M
        most = room.max_m[axis] - radius_m - _CLEARANCE_M
        speed, stop = velocity_m_s[axis], stop_m[axis]
        if (speed > 0 and stop > most) or (speed < 0 and stop < least):
            return True
    moves = velocity_m_s[0] != 0.0 or velocity_m_s[1] != 0.0 or velocity_m_s[2] != 0.0
    return moves and _is_solid_at(room, stop_m[0], stop_m[1], stop_m[2], 0)


@reference_free_njit()
def is_open_ahead(room, radius_m, state, longest_s):
    """Return whether `is_edge_ahead` is false wherever a vehicle stops that takes no longer than a time to it.

    The way to a stop after T is T v/2 + T^2 a/12, see `set_quartic_to_velocity_inplace`.

    Args:
        room: Record of `ROOM`.
        radius_m: The vehicle's radius [m].
        state: (3, 3) rows place [m], velocity [m/s], acceleration [m/s^2], world frame.
        longest_s: How long it takes at most [s].

    Held by:
        tests/unit/training/batch/test_braking_kernels.py
    """
    x0, x1 = _stops_between(state, 0, longest_s)
    y0, y1 = _stops_between(state, 1, longest_s)
    z0, z1 = _stops_between(state, 2, longest_s)
    keeps_m = radius_m + _CLEARANCE_M
    low, high = room.origin_m, room.max_m
    if x0 < low[0] + keeps_m or y0 < low[1] + keeps_m or z0 < low[2] + keeps_m:
        return False
    if x1 > high[0] - keeps_m or y1 > high[1] - keeps_m or z1 > high[2] - keeps_m:
        return False
    # All cells between two corners.
    cell_m = room.cell_m
    i0, j0, k0 = _cell(x0, low[0], cell_m), _cell(y0, low[1], cell_m), _cell(z0, low[2], cell_m)
    nx, ny, nz = room.shape[0], room.shape[1], room.shape[2]
    i1 = min(_cell(x1, low[0], cell_m), nx - 1) + 1
    j1 = min(_cell(y1, low[1], cell_m), ny - 1) + 1
    k1 = min(_cell(z1, low[2], cell_m), nz - 1) + 1
    sums = array_at(room.solid_sums, (nx + 1, ny + 1, nz + 1), np.int32)
    n_solid = (
        sums[i1, j1, k1] - sums[i0, j1, k1] - sums[i1, j0, k1] - sums[i1, j1, k0]
        + sums[i0, j0, k1] + sums[i0, j1, k0] + sums[i1, j0, k0] - sums[i0, j0, k0]
    )  # fmt: skip
    return n_solid == 0


@reference_free_njit()
def _stops_between(state, axis, longest_s):
    place_m = state[0, axis]
    by_speed = longest_s * state[1, axis] * 0.5
    by_force = longest_s * longest_s * state[2, axis] / 12.0
    low, high = min(by_speed, 0.0) + min(by_force, 0.0), max(by_speed, 0.0) + max(by_force, 0.0)
    return place_m + low - _ROUNDING_M, place_m + high + _ROUNDING_M


@reference_free_njit()
def is_in_room(room, position_m):
    """Return whether a place (3,) is in the room, or no further out than floors and walls give way."""
    for axis in range(3):
        value = position_m[axis]
        if not room.origin_m[axis] - _GIVES_WAY_M <= value <= room.max_m[axis] + _GIVES_WAY_M:
            return False
    return True


@reference_free_njit()
def touches(room, radius_m, position_m):
    """Return whether a ball touches one of the room's boxes.

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
    """Return whether an upright disc is in one of the room's boxes.

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


# Which members of the list of boxes may be near.
@reference_free_njit()
def _near_boxes(room, position_m) -> Any:
    i = _cell(position_m[0], room.near_origin_m[0], room.near_block_m)
    j = _cell(position_m[1], room.near_origin_m[1], room.near_block_m)
    k = _cell(position_m[2], room.near_origin_m[2], room.near_block_m)
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
def wind_at_inplace(wind_m_s, room, time_s, x_m, y_m, z_m):
    """Write the room's wind (3,) [m/s] at a time since the sources opened [s] and a place, world frame [m]."""
    n_frames = room.wind_shape[0]
    frame = int(time_s / room.wind_period_s + 1e-9)
    frame = frame % n_frames if room.wind_loops else min(frame, n_frames - 1)
    nx, ny, nz = room.wind_shape[1], room.wind_shape[2], room.wind_shape[3]
    wind = array_at(room.wind + frame * nx * ny * nz * 12, (nx, ny, nz, 3), np.float32)
    origin_m = (room.origin_m[0], room.origin_m[1], room.origin_m[2])
    wind_m_s[0], wind_m_s[1], wind_m_s[2] = trilinear_wind(wind, origin_m, room.cell_m, x_m, y_m, z_m)
