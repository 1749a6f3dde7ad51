"""Ray casting among boxes and upright cylinders.

Arguments of several functions: `x`, `y`, `z` start of the ray, world frame [m]; `dx`, `dy`, `dz` its direction of
length 1, world frame.
"""
# pyright: basic, reportCallIssue=false, reportGeneralTypeIssues=false

import math

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from gslcosim.environment.grid_kernels import to_next_border

# Distance by which rays may seem to miss from rounding alone; the bins' boxes are sorted in with as much.
_ROUNDING_BINS = 1e-9


@intrinsic
def _fused_multiply_add(typingctx, a, b, c):
    # a b + c, rounded once.
    def codegen(context, builder: ir.IRBuilder, _signature, arguments):
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), codegen


@numba.njit(cache=True, nogil=True)
def turn_ray(rotation, x, y, z):
    """Return the direction of a ray in the world frame.

    Its sums are rounded as matrix products are where the processor multiplies and adds at once, and so on any.

    Args:
        rotation: (9,) rows of the matrix that turns body-frame into world-frame vectors.
        x, y, z: Direction of length 1, body frame.

    Held by:
        tests/unit/services/sensing/test_ray_kernels.py
    """
    return (
        _fused_multiply_add(rotation[2], z, _fused_multiply_add(rotation[1], y, rotation[0] * x)),
        _fused_multiply_add(rotation[5], z, _fused_multiply_add(rotation[4], y, rotation[3] * x)),
        _fused_multiply_add(rotation[8], z, _fused_multiply_add(rotation[7], y, rotation[6] * x)),
    )


@numba.njit(cache=True, nogil=True)
def turn_rays(rotation, directions):
    """Return directions (n, 3) in the world frame."""
    turned = np.empty(directions.shape)
    for n in range(directions.shape[0]):
        x, y, z = directions[n, 0], directions[n, 1], directions[n, 2]
        turned[n, 0], turned[n, 1], turned[n, 2] = turn_ray(rotation, x, y, z)
    return turned


@numba.njit(cache=True, nogil=True)
def distance_to_box(box_m, x, y, z, dx, dy, dz):
    """Return the way along a ray to a box, infinity where it misses; 0 from within.

    Slabs: the ray is inside the box between the last entry and the first exit of its three pairs of faces.

    Args:
        box_m: (6,) lower then upper corner, world frame [m].

    Held by:
        tests/unit/services/sensing/test_ray_kernels.py (closed forms, and a march in small steps)
    """
    enters, leaves = 0.0, np.inf
    for axis in range(3):
        start = x if axis == 0 else (y if axis == 1 else z)
        direction = dx if axis == 0 else (dy if axis == 1 else dz)
        low, high = box_m[axis] - start, box_m[3 + axis] - start
        if direction == 0.0:
            if low > 0.0 or high < 0.0:
                return np.inf
            continue
        near, far = low / direction, high / direction
        if near > far:
            near, far = far, near
        enters, leaves = max(enters, near), min(leaves, far)
    return enters if enters <= leaves else np.inf


@numba.njit(cache=True, nogil=True)
def distance_to_cylinder(cylinder_m, x, y, z, dx, dy, dz):
    """Return the way along a ray to an upright cylinder, infinity where it misses; 0 from within.

    Args:
        cylinder_m: (5,) centre xyz, radius and half height, world frame [m].

    Held by:
        tests/unit/services/sensing/test_ray_kernels.py
    """
    enters, leaves = 0.0, np.inf
    px, py, pz = x - cylinder_m[0], y - cylinder_m[1], z - cylinder_m[2]
    a = dx * dx + dy * dy
    b = px * dx + py * dy
    c = px * px + py * py - cylinder_m[3] ** 2
    if a > 0.0:
        under_root = b * b - a * c
        if under_root < 0.0:
            return np.inf
        root = math.sqrt(under_root)
        enters, leaves = max(enters, (-b - root) / a), (-b + root) / a
    elif c > 0.0:
        return np.inf
    if dz != 0.0:
        near, far = (-cylinder_m[4] - pz) / dz, (cylinder_m[4] - pz) / dz
        enters, leaves = max(enters, min(near, far)), min(leaves, max(near, far))
    elif abs(pz) > cylinder_m[4]:
        return np.inf
    return enters if enters <= leaves else np.inf


@numba.njit(cache=True, nogil=True)
def _within(start, direction, n):
    # Ways along a ray to where it comes between two faces, and to where it leaves; in bins.
    if direction == 0.0:
        return (-np.inf, np.inf) if 0.0 <= start <= n else (np.inf, -np.inf)
    one, other = -start / direction, (n - start) / direction
    return min(one, other), max(one, other)


@numba.njit(cache=True, nogil=True)
def _distance_to_bins(sx, sy, sz, dx, dy, dz, shape):
    # Way along a ray to the first bin, 0 from within, infinity where it misses them all; in bins. Boxes that reach to
    # the outer faces must not be lost by rounding: a ray that misses by that little counts as one that meets.
    near_x, far_x = _within(sx, dx, shape[0])
    near_y, far_y = _within(sy, dy, shape[1])
    near_z, far_z = _within(sz, dz, shape[2])
    enters = max(0.0, near_x, near_y, near_z)
    return enters if enters <= min(far_x, far_y, far_z) + _ROUNDING_BINS else np.inf


@numba.njit(cache=True, nogil=True)
def distance_among_boxes(boxes_m, first, members, origin_m, bin_m, shape, x, y, z, dx, dy, dz, limit_m):
    """Return the way along a ray to the nearest of many boxes, at most `limit_m`.

    The ray visits the bins it passes through in order, and stops at the first hit within the bin that it is in. One
    that starts outside all bins begins where it meets them.

    Args:
        boxes_m: (n, 6) lower then upper corners, world frame [m].
        first: (n_bins + 1,) where each bin's part of `members` begins; bins in C order.
        members: Indices of the boxes that reach into each bin.
        origin_m: (3,) corner of bin (0, 0, 0), world frame [m].
        bin_m: Edge of the bins [m].
        shape: (3,) number of bins along each axis.
        limit_m: Farthest distance of interest [m].

    Source:
        Amanatides and Woo 1987, A fast voxel traversal algorithm for ray tracing, Eurographics, section 2.
    Held by:
        tests/unit/services/sensing/test_ray_kernels.py (against every box one by one)
    """
    nearest = limit_m
    sx, sy, sz = (x - origin_m[0]) / bin_m, (y - origin_m[1]) / bin_m, (z - origin_m[2]) / bin_m
    enters = _distance_to_bins(sx, sy, sz, dx, dy, dz, shape)
    if enters * bin_m >= limit_m:
        return limit_m
    i = min(max(math.floor(sx + enters * dx), 0), shape[0] - 1)
    j = min(max(math.floor(sy + enters * dy), 0), shape[1] - 1)
    k = min(max(math.floor(sz + enters * dz), 0), shape[2] - 1)
    next_x, gap_x = to_next_border(sx, i, dx)
    next_y, gap_y = to_next_border(sy, j, dy)
    next_z, gap_z = to_next_border(sz, k, dz)
    while 0 <= i < shape[0] and 0 <= j < shape[1] and 0 <= k < shape[2]:
        i_bin = (i * shape[1] + j) * shape[2] + k
        for m in range(first[i_bin], first[i_bin + 1]):
            nearest = min(nearest, distance_to_box(boxes_m[members[m]], x, y, z, dx, dy, dz))
        if nearest <= min(next_x, next_y, next_z) * bin_m:
            return nearest
        if next_x <= next_y and next_x <= next_z:
            i += 1 if dx > 0.0 else -1
            next_x += gap_x
        elif next_y <= next_z:
            j += 1 if dy > 0.0 else -1
            next_y += gap_y
        else:
            k += 1 if dz > 0.0 else -1
            next_z += gap_z
    return nearest


@numba.njit(cache=True, nogil=True)
def cast_rays(boxes_m, first, members, origin_m, bin_m, shape, cylinders_m, start_m, directions, limit_m):
    """Return the (n,) distances along rays from one point to the nearest object, `limit_m` where none is nearer [m].

    Args:
        boxes_m, first, members, origin_m, bin_m, shape: See `distance_among_boxes`.
        cylinders_m: (m, 5) centres xyz, radii and half heights of upright cylinders, world frame [m].
        start_m: (3,) where all rays start, world frame [m].
        directions: (n, 3) unit vectors, world frame.
        limit_m: Farthest distance of interest [m].

    Held by:
        tests/unit/services/sensing/test_ray_kernels.py, tests/unit/services/sensing/test_range_finders.py
    """
    distances_m = np.empty(directions.shape[0])
    x, y, z = start_m[0], start_m[1], start_m[2]
    for n in range(directions.shape[0]):
        dx, dy, dz = directions[n, 0], directions[n, 1], directions[n, 2]
        nearest = limit_m
        for m in range(cylinders_m.shape[0]):
            nearest = min(nearest, distance_to_cylinder(cylinders_m[m], x, y, z, dx, dy, dz))
        distances_m[n] = distance_among_boxes(
            boxes_m, first, members, origin_m, bin_m, shape, x, y, z, dx, dy, dz, nearest
        )
    return distances_m


@numba.njit(cache=True, nogil=True)
def noisy_range_m(range_m, limit_m, noise_m):
    """Return a range with noise [m], between 0 and `limit_m`; where nothing is in range, it stays `limit_m`.

    Held by:
        tests/unit/services/sensing/test_range_finders.py
    """
    return min(max(range_m + noise_m, 0.0), limit_m) if range_m < limit_m else limit_m


@numba.njit(cache=True, nogil=True)
def disturb_ranges_inplace(ranges_m, limit_m, noise_m):
    """Add a noise each, (n,) [m], to ranges (n,) [m]."""
    for n in range(ranges_m.shape[0]):
        ranges_m[n] = noisy_range_m(ranges_m[n], limit_m, noise_m[n])
