"""Where a vehicle may be in a room, and what it touches."""
# pyright: basic

import math

import numba
import numpy as np
from llvmlite import ir
from numba import (
    carray,  # pyright: ignore[reportPrivateImportUsage]
    types,
)
from numba.extending import intrinsic

from gslcosim.environment.wind_kernels import trilinear_wind

_SOLID = 1
# What a vehicle may stray from its reference while it brakes; see `gslcosim.world.paths.space`.
_CLEARANCE_M = 0.1
# What floors and walls give way; see `gslcosim.referee.case`.
_GIVES_WAY_M = 0.05


@intrinsic
def pointer_to(typingctx, address):
    """Return the pointer that an integer holds."""
    signature = types.voidptr(types.int64)

    def codegen(context, builder, _signature, arguments):
        return builder.inttoptr(arguments[0], ir.IntType(8).as_pointer())

    return signature, codegen


@numba.njit(cache=True, nogil=True)
def _cell(coordinate_m, origin_m, cell_m):
    return math.floor((coordinate_m - origin_m) / cell_m)


@numba.njit(cache=True, nogil=True)
def _is_solid_at(room, x_m, y_m, z_m, least):
    # The cell that holds a place, or the nearest of the grid: above it always, below it where `least` is 0.
    nx, ny, nz = room.shape[0], room.shape[1], room.shape[2]
    i = max(min(_cell(x_m, room.origin_m[0], room.cell_m), nx - 1), least)
    j = max(min(_cell(y_m, room.origin_m[1], room.cell_m), ny - 1), least)
    k = max(min(_cell(z_m, room.origin_m[2], room.cell_m), nz - 1), least)
    occupancy = carray(pointer_to(room.occupancy), (nx, ny, nz), np.uint8)  # pyright: ignore[reportCallIssue]
    return occupancy[i, j, k] == _SOLID


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
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


@numba.njit(cache=True, nogil=True)
def is_in_room(room, position_m):
    """Return whether a place (3,) is in the room, or no further out than floors and walls give way."""
    for axis in range(3):
        value = position_m[axis]
        if not room.origin_m[axis] - _GIVES_WAY_M <= value <= room.max_m[axis] + _GIVES_WAY_M:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def touches(room, radius_m, position_m):
    """Return whether a ball touches one of the room's boxes.

    Args:
        room: Record of `ROOM`.
        radius_m: Of the ball [m].
        position_m: (3,) its centre, world frame [m].
    """
    i = _cell(position_m[0], room.near_origin_m[0], room.near_block_m)
    j = _cell(position_m[1], room.near_origin_m[1], room.near_block_m)
    k = _cell(position_m[2], room.near_origin_m[2], room.near_block_m)
    nx, ny, nz = room.near_shape[0], room.near_shape[1], room.near_shape[2]
    if i < 0 or j < 0 or k < 0 or i >= nx or j >= ny or k >= nz:
        return False
    block = (i * ny + j) * nz + k
    first = carray(pointer_to(room.near_first), nx * ny * nz + 1, np.int32)  # pyright: ignore[reportCallIssue]
    begin, end = first[block], first[block + 1]
    if begin == end:
        return False
    members = carray(pointer_to(room.near_members), first[nx * ny * nz], np.int32)  # pyright: ignore[reportCallIssue]
    boxes_m = carray(pointer_to(room.boxes_m), (room.n_boxes, 6), np.float64)  # pyright: ignore[reportCallIssue]
    for n in range(begin, end):
        box_m = boxes_m[members[n]]
        gap2_m2 = 0.0
        for axis in range(3):
            gap_m = max(box_m[axis] - position_m[axis], position_m[axis] - box_m[3 + axis], 0.0)
            gap2_m2 += gap_m * gap_m
        if gap2_m2 < radius_m * radius_m:
            return True
    return False


@numba.njit(cache=True, nogil=True)
def wind_at_inplace(wind_m_s, room, time_s, x_m, y_m, z_m):
    """Write the room's wind (3,) [m/s] at a time since the sources opened [s] and a place, world frame [m]."""
    n_frames = room.wind_shape[0]
    frame = int(time_s / room.wind_period_s + 1e-9)
    frame = frame % n_frames if room.wind_loops else min(frame, n_frames - 1)
    nx, ny, nz = room.wind_shape[1], room.wind_shape[2], room.wind_shape[3]
    wind = carray(pointer_to(room.wind + frame * nx * ny * nz * 12), (nx, ny, nz, 3), np.float32)  # pyright: ignore[reportCallIssue]
    origin_m = (room.origin_m[0], room.origin_m[1], room.origin_m[2])
    wind_m_s[0], wind_m_s[1], wind_m_s[2] = trilinear_wind(wind, origin_m, room.cell_m, x_m, y_m, z_m)
