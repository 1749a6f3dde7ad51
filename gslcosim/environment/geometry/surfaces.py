"""All surfaces of a geometry as triangles, and which of them make a body."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.geometry.mesh_formats import Part
from gslcosim.environment.geometry.surface_kernels import join_inplace

# Corners closer than this are one: coordinates of files have single precision [m].
SAME_M = 1e-5


@dataclass(frozen=True, kw_only=True)
class Surfaces:
    """Triangles of a geometry, world frame [m].

    `corners_m` is (n, 3, 3): triangle, corner, xyz. `part` (n,) is the index into `names`, -1 where an opening is
    drawn. `body` (n,) numbers what hangs together through edges of two triangles within a part. `closed` has one
    entry for each body: whether two of its triangles meet at each of its edges.
    """

    corners_m: NDArray[np.float64]
    part: NDArray[np.int32]
    body: NDArray[np.int32]
    closed: NDArray[np.bool_]
    names: tuple[str, ...]

    def is_opening(self, triangles: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of the triangles, given by index, belong to openings."""
        return self.part[triangles] < 0


def surfaces_of(parts: Sequence[Part], opening_corners_m: NDArray[np.float64]) -> Surfaces:
    """Return the triangles of all parts and openings; those without area and doubles within a part are left out.

    Args:
        parts: Walls, furniture and whatever else is solid.
        opening_corners_m: (n, 3, 3) triangles of openings.
    """
    corners: list[NDArray[np.float64]] = []
    bodies: list[NDArray[np.int32]] = []
    closed: list[NDArray[np.bool_]] = []
    n_bodies = 0
    for part in parts:
        faces = part.faces[_areas_m2(part.vertices_m[part.faces]) > 0]
        merged = _merged(part.vertices_m)[faces]
        is_kept = _first_of_doubles(merged)
        body, is_closed = _bodies_of(merged[is_kept])
        corners.append(part.vertices_m[faces[is_kept]])
        bodies.append(body + np.int32(n_bodies))
        closed.append(is_closed)
        n_bodies += len(is_closed)
    counts = [len(part_corners) for part_corners in corners]
    opening_corners_m = opening_corners_m[_areas_m2(opening_corners_m) > 0]
    n_openings = len(opening_corners_m)
    return Surfaces(
        corners_m=np.concatenate((*corners, opening_corners_m)),
        part=np.concatenate((np.repeat(np.arange(len(parts)), counts), np.full(n_openings, -1))).astype(np.int32),
        body=np.concatenate((*bodies, np.full(n_openings, n_bodies))).astype(np.int32),
        closed=np.concatenate((*closed, np.zeros(1, np.bool_))),
        names=tuple(part.name for part in parts),
    )


# Of triangles between the same corners, whichever way they turn, the first.
def _first_of_doubles(faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    a, b, c = np.sort(faces, axis=1).T
    order, is_first = _in_groups(a, b, c)
    is_kept = np.empty(len(faces), np.bool_)
    is_kept[order] = is_first
    return is_kept


# The order by several keys, equal ones as they were, and where in that order a new combination of them begins.
def _in_groups(*keys: NDArray[np.integer]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    lows = [key.min(initial=0) for key in keys]
    sides = [int(key.max(initial=0) - low) + 1 for key, low in zip(keys, lows, strict=True)]
    # As one number they are sorted four times as fast as one after the other.
    if math.prod(sides) < 2**62:
        offsets = tuple(key - low for key, low in zip(keys, lows, strict=True))
        keys = (np.asarray(np.ravel_multi_index(offsets, sides)),)
    order = np.lexsort(keys[::-1])
    is_first = np.zeros(len(order), np.bool_)
    is_first[:1] = True
    for key in keys:
        is_first[1:] |= np.diff(key[order]) != 0
    return order, is_first


# Zero where the triangle is thinner than a nanometre.
def _areas_m2(corners_m: NDArray[np.float64]) -> NDArray[np.float64]:
    edges_m = np.roll(corners_m, -1, axis=1) - corners_m
    areas_m2 = np.linalg.norm(np.cross(edges_m[:, 0], edges_m[:, 1]), axis=1) / 2
    longest_m = np.linalg.norm(edges_m, axis=2).max(axis=1, initial=0.0)
    return np.where(areas_m2 > 1e-9 * longest_m, areas_m2, 0.0)


# The number of each vertex when those at one place are one.
def _merged(vertices_m: NDArray[np.float64]) -> NDArray[np.int64]:
    cells = np.round(vertices_m / SAME_M).astype(np.int64)
    order, is_first = _in_groups(*cells.T[::-1])
    merged = np.empty(len(cells), dtype=np.int64)
    merged[order] = np.cumsum(is_first) - 1
    return merged


def _bodies_of(faces: NDArray[np.int64]) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    edges = np.sort(np.stack((faces, np.roll(faces, -1, axis=1)), axis=2).reshape(-1, 2), axis=1)
    keys = edges[:, 0] * (faces.max(initial=0) + 1) + edges[:, 1]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    lengths = np.diff(starts, append=len(order))
    pairs = starts[lengths == 2]
    owner = order // 3
    roots = np.arange(len(faces))
    join_inplace(roots, owner[pairs], owner[pairs + 1])
    _, body = np.unique(roots, return_inverse=True)
    closed = np.ones(int(body.max(initial=-1)) + 1, dtype=np.bool_)
    # Bodies that touch share edges: of each edge, a body's own triangles count.
    owners = np.repeat(body, 3)
    order, is_first = _in_groups(keys, owners)
    starts = np.flatnonzero(is_first)
    n_triangles = np.diff(starts, append=len(order))
    closed[owners[order[starts[n_triangles != 2]]]] = False
    return body.astype(np.int32), closed
