"""Faces inside obstacles that mirror the velocity along the obstacle's surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.pressure import F32
from gslcosim.flow.pressure_kernels import HIGH, LOW


@dataclass(frozen=True, kw_only=True)
class GhostFaces:
    """Of one velocity component: the solid faces beside air, and the open faces that each mirrors.

    `faces`: (n,) flat padded indices. Ghost i mirrors `sources[starts[i] : starts[i + 1]]`, flat padded indices.
    """

    faces: NDArray[np.int64]
    starts: NDArray[np.int64]
    sources: NDArray[np.int64]


def find_ghosts(air: NDArray[np.bool_], coefficients: tuple[F32, F32, F32]) -> tuple[GhostFaces, ...]:
    """Return the ghost faces of the x-, y- and z-velocities.

    Args:
        air: Padded cells, True is air.
        coefficients: Padded coefficients of the low-x, low-y and low-z faces, above 0 where open.
    """
    inside = np.zeros_like(air)
    inside[(slice(LOW, -HIGH),) * 3] = True
    solid = inside & ~air
    return tuple(_ghosts_of(axis, solid, coefficients[axis] > 0) for axis in range(3))


def _ghosts_of(axis: int, solid: NDArray[np.bool_], is_open: NDArray[np.bool_]) -> GhostFaces:
    # Both cells of the face are solid: faces between air and solid are walls, with no velocity through them.
    is_solid_face = solid & np.roll(solid, 1, axis=axis)
    strides = (solid.shape[1] * solid.shape[2], solid.shape[2], 1)
    faces, sources = [], []
    for other in (a for a in range(3) if a != axis):
        for sign in (-1, 1):
            here = np.flatnonzero(is_solid_face & np.roll(is_open, -sign, axis=other))
            faces.append(here)
            sources.append(here + sign * strides[other])
    all_faces, all_sources = np.concatenate(faces), np.concatenate(sources)
    order = np.argsort(all_faces, kind="stable")
    unique, counts = np.unique(all_faces, return_counts=True)
    starts = np.concatenate(([0], np.cumsum(counts)))
    return GhostFaces(faces=unique, starts=starts, sources=all_sources[order])
