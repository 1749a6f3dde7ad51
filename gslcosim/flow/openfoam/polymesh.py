"""Polyhedral mesh of OpenFOAM from a grid of cells, so that no meshing tool is needed."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.boundaries.domain import Bool, Domain, PlacedPatch
from gslcosim.flow.boundaries.patches import MovingWall
from gslcosim.flow.pressure import HIGH, LOW

Int = NDArray[np.int64]

WALLS = "walls"


@dataclass(frozen=True, kw_only=True)
class Boundary:
    """Boundary faces with one condition; `placed` is absent for the walls at rest, obstacles included."""

    name: str
    placed: PlacedPatch | None
    first_face: int
    n_faces: int

    @property
    def is_wall(self) -> bool:
        """True if air rubs on it."""
        return self.placed is None or isinstance(self.placed.patch, MovingWall)


@dataclass(frozen=True, kw_only=True)
class PolyMesh:
    """Air cells as a polyhedral mesh.

    Attributes:
        air: (nx, ny, nz) True is a cell of the mesh; cells are numbered in C order.
        points_m: (n, 3) corners, xyz [m].
        faces: (f, 4) points around each face, seen from its owner's outside anticlockwise.
        owners: (f,) cell of lower number at each face.
        neighbours: (g,) the other cell of the first g faces; the rest lie on the boundary.
        boundaries: What the rest is, in the order of the faces.
    """

    air: Bool
    points_m: NDArray[np.float64]
    faces: Int
    owners: Int
    neighbours: Int
    boundaries: tuple[Boundary, ...]

    @property
    def n_cells(self) -> int:
        """Return the number of cells."""
        return int(np.count_nonzero(self.air))


def build_polymesh(domain: Domain) -> PolyMesh:
    """Return the mesh of a domain's air, faces in OpenFOAM's upper-triangular order.

    Inner faces come first, by owner and then by neighbour; boundary faces follow, by boundary and then by owner.
    """
    air = domain.air[(slice(LOW, -HIGH),) * 3]
    labels = np.full(air.shape, -1, np.int64)
    labels[air] = np.arange(np.count_nonzero(air))
    faces, owners, neighbours = _inner_faces(air, labels)
    outer_faces, outer_owners, owner_patches = _outer_faces(air, labels, domain.placed)
    used, corners = np.unique(np.concatenate((faces, outer_faces)), return_inverse=True)
    lattice = np.stack(np.unravel_index(used, tuple(n + 1 for n in air.shape)), axis=-1)
    return PolyMesh(
        air=air,
        points_m=np.asarray(lattice * domain.cell_m, np.float64),
        faces=corners.reshape(-1, 4),
        owners=np.concatenate((owners, outer_owners)),
        neighbours=neighbours,
        boundaries=_boundaries(owner_patches, domain.placed, n_inner=len(faces)),
    )


# Corner points, as lattice indices, of the low or high faces of cells on one axis; anticlockwise from outside.
def _corners(cells: tuple[Int, ...], shape: tuple[int, ...], axis: int, *, is_high: bool) -> Int:
    strides = ((shape[1] + 1) * (shape[2] + 1), shape[2] + 1, 1)
    first = sum(index * stride for index, stride in zip(cells, strides)) + is_high * strides[axis]
    b, c = strides[(axis + 1) % 3], strides[(axis + 2) % 3]
    around = (0, b, b + c, c) if is_high else (0, c, b + c, b)
    return np.stack([first + step for step in around], axis=-1)


def _inner_faces(air: Bool, labels: Int) -> tuple[Int, Int, Int]:
    faces, owners, neighbours = [], [], []
    for axis in range(3):
        here = air & _beyond(air, axis, is_high=True)
        faces.append(_corners(np.nonzero(here), air.shape, axis, is_high=True))
        owners.append(labels[here])
        neighbours.append(np.roll(labels, -1, axis=axis)[here])
    face, owner, neighbour = (np.concatenate(parts) for parts in (faces, owners, neighbours))
    order = np.lexsort((neighbour, owner))
    return face[order], owner[order], neighbour[order]


# Boundary faces with their owners and the index of their patch; walls at rest have the index after the last patch.
def _outer_faces(air: Bool, labels: Int, placed: tuple[PlacedPatch, ...]) -> tuple[Int, Int, Int]:
    faces, owners, patches = [], [], []
    for axis in range(3):
        for is_high in (False, True):
            here = air & ~_beyond(air, axis, is_high=is_high)
            faces.append(_corners(np.nonzero(here), air.shape, axis, is_high=is_high))
            owners.append(labels[here])
            patches.append(_patch_numbers(air.shape, placed, axis, is_high=is_high)[here])
    face, owner, patch = (np.concatenate(parts) for parts in (faces, owners, patches))
    order = np.lexsort((owner, patch))
    return face[order], owner[order], patch[order]


# Whether there is air beyond the low or high face of each cell.
def _beyond(air: Bool, axis: int, *, is_high: bool) -> Bool:
    beyond = np.roll(air, -1 if is_high else 1, axis=axis)
    edge: list[slice | int] = [slice(None)] * 3
    edge[axis] = -1 if is_high else 0
    beyond[tuple(edge)] = False
    return beyond


def _patch_numbers(shape: tuple[int, ...], placed: tuple[PlacedPatch, ...], axis: int, *, is_high: bool) -> Int:
    numbers = np.full(shape, len(placed), np.int64)
    for number, patch in enumerate(placed):
        if (patch.axis, patch.is_high) == (axis, is_high):
            where: list[slice | int] = list(patch.rows)
            where.insert(axis, -1 if is_high else 0)
            numbers[tuple(where)] = number
    return numbers


def _boundaries(patches: Int, placed: tuple[PlacedPatch, ...], *, n_inner: int) -> tuple[Boundary, ...]:
    counts = np.bincount(patches, minlength=len(placed) + 1)
    firsts = n_inner + np.concatenate(([0], np.cumsum(counts)))
    every = (*placed, None)
    return tuple(
        Boundary(name=_name_of(number, patch), placed=patch, first_face=int(first), n_faces=int(count))
        for number, (patch, first, count) in enumerate(zip(every, firsts, counts))
    )


def _name_of(number: int, placed: PlacedPatch | None) -> str:
    return WALLS if placed is None else f"{type(placed.patch).__name__.lower()}_{number}"
