# pyright: basic
# ruff: noqa: ANN001, ANN201 - kernels have no types, and symbols of equations
"""Domain of the solver: open faces, boundary conditions, ghost faces in obstacles, and lips of obstacles."""

from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.base.scalar_kernels import norm3
from gslcosim.flow.patches import Inlet, MovingWall, Outlet, Patch, PlacedPatch, check_kinds, check_overlap, place_patch
from gslcosim.flow.pressure import F32, HIGH, LOW

Int = NDArray[np.int64]
MAX_CELLS = 200_000_000
BYTES_PER_CELL = 130  # of the solver's arrays, including padding and multigrid levels; measured by the benchmark
Bool = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class OpeningEdges:
    """Edges where the velocity `component` along a face is carried by the velocity `carrier` past the obstacle's lip.

    All indices are flat and padded, one for each of n edges.

    `near`: open face of `component` before the lip. `behind`: the one before that. `through`: face of `carrier`
    beside the lip. `target`: open face of `component` past the lip, one cell away from the obstacle.
    `away`: sign of `component` away from the obstacle. `inward`: sign of `carrier` past the lip.
    """

    component: int
    carrier: int
    near: Int
    behind: Int
    through: Int
    target: Int
    away: F32
    inward: F32


def find_opening_edges(air: NDArray[np.bool_], coefficients: tuple[F32, F32, F32]) -> tuple[OpeningEdges, ...]:
    """Return the lips of all obstacles, one list for each component and carrier that has any.

    Args:
        air: Padded cells, True is air.
        coefficients: Padded coefficients of the low-x, low-y and low-z faces: 0 closed, 1 open, 2 outlet.
    """
    pairs = ((component, carrier) for component in range(3) for carrier in range(3) if carrier != component)
    lists = (_lips_of(component, carrier, air, coefficients[component]) for component, carrier in pairs)
    return tuple(edges for edges in lists if edges.near.size)


def _lips_of(component: int, carrier: int, air: NDArray[np.bool_], coefficient: F32) -> OpeningEdges:
    strides = (air.shape[1] * air.shape[2], air.shape[2], 1)
    along, across = strides[component], strides[carrier]
    below = np.roll(air, 1, axis=component)
    parts = []
    for away in (1, -1):
        is_wall = (air & ~below if away > 0 else below & ~air) & (coefficient == 0)
        for side in (1, -1):
            is_lip = is_wall & (np.roll(coefficient, -side, axis=carrier) == 1)
            is_lip &= np.roll(coefficient, -away, axis=component) == 1
            wall = np.flatnonzero(is_lip)
            cell = wall if away > 0 else wall - along
            through = cell + across if side > 0 else cell
            signs = (np.full(wall.size, away), np.full(wall.size, -side))
            parts.append((wall + side * across, wall + 2 * side * across, through, wall + away * along, *signs))
    near, behind, through, target, away, inward = (np.concatenate(columns) for columns in zip(*parts))
    return OpeningEdges(
        component=component,
        carrier=carrier,
        near=near,
        behind=behind,
        through=through,
        target=target,
        away=away.astype(np.float32),
        inward=inward.astype(np.float32),
    )


@numba.njit(cache=True, nogil=True)
def carry_past_edges(velocity, carrier, near, behind, through, target, away, inward, dt_s, cell_m, stage_weight, out):
    """Give the momentum that is swept past an obstacle's edge to the first open face behind it, in place.

    out_t += g dt / h * (c / 2) * u_e,   u_e = u_n - u_b / 4
    [m/s] = [s] / [m] * [m/s] [m/s];   u_e: linear-upwind value at the edge, where the wall's face ahead has none

    Air that flows along a face towards a gap carries its momentum along the face past the lip. On the staggered grid
    the half of it that arrives beside the wall would enter the control volume of a closed face and be lost: the jet
    behind the gap would be too wide and too slow. Momentum away from the wall, which the wall cannot absorb, goes to
    the next face; momentum towards the wall is absorbed by the wall.

    In homes with doors five cells wide the wind after 5 s differs from pimpleFoam's by 0.17 instead of 0.19, and on
    half the cells by 0.13 instead of 0.15 (relative root mean square).

    Args:
        velocity: Flat padded velocities of the component at the start of the stage [m/s].
        carrier: Flat padded velocities that carry it [m/s].
        near: (n,) flat index of the open face before the lip, u_n.
        behind: (n,) of the face before that, u_b.
        through: (n,) of the carrier's face, c.
        target: (n,) of the face that receives it, t.
        away: (n,) sign of the component away from the wall.
        inward: (n,) sign of the carrier past the lip.
        dt_s: Time step [s].
        cell_m: Edge of a cell, h [m].
        stage_weight: g of the Runge-Kutta stage.
        out: Flat padded velocities of the component at its end [m/s], modified.

    Source: our derivation, from the momentum balance of the closed face's control volume.
    Held by:
        tests/unit/flow/test_opening_edges.py, tests/analytic/flow/test_pimplefoam_rooms.py
    """
    factor = np.float32(stage_weight * dt_s / cell_m)
    half = np.float32(0.5)
    quarter = np.float32(0.25)
    for n in range(near.shape[0]):
        speed = half * inward[n] * carrier[through[n]]
        value = velocity[near[n]] - quarter * velocity[behind[n]]
        if speed > 0 and away[n] * value > 0:
            out[target[n]] += factor * speed * value


@numba.njit(cache=True, nogil=True)
def flood(air, reached, seeds, stride_x, stride_y):
    """Mark all air that can be reached from the seeds through cell faces, breadth first.

    Args:
        air: (n,) flat padded cells, True is air; the padding is not air, so no index leaves the array.
        reached: (n,) all False at first, written.
        seeds: (m,) flat indices of air cells to start from.
        stride_x: Distance of x-neighbours in the flat array.
        stride_y: Same for y-neighbours; z-neighbours are adjacent.

    Held by:
        tests/unit/flow/test_domain.py (a sealed chamber is left out)
    """
    queue = np.empty(np.count_nonzero(air) + 1, np.int64)
    head, tail = 0, 0
    for seed in seeds:
        reached[seed] = True
        queue[tail] = seed
        tail += 1
    while head < tail:
        cell = queue[head]
        head += 1
        for step in (stride_x, -stride_x, stride_y, -stride_y, 1, -1):
            neighbour = cell + step
            if air[neighbour] and not reached[neighbour]:
                reached[neighbour] = True
                queue[tail] = neighbour
                tail += 1


@dataclass(frozen=True, kw_only=True)
class GhostFaces:
    """Ghost faces of one velocity component: the solid faces beside air, and the open faces that each mirrors.

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


@dataclass(frozen=True, kw_only=True)
class WallFriction:
    """Cells that touch a wall, and for each velocity component the half faces that walls slow down.

    `cells`: (n,) flat padded index of each wall cell; `velocity_m_s`: (n, 3) of its wall (mean of its wall faces). Per
    component, `faces`: (m,) flat padded index of the face; `owners`: (m,) the wall cell that acts on it, as index into
    `cells`; `wall_speed_m_s`: (m,) of that wall along the component.
    """

    cells: NDArray[np.int64]
    velocity_m_s: F32
    faces: tuple[NDArray[np.int64], ...]
    owners: tuple[NDArray[np.int32], ...]
    wall_speed_m_s: tuple[F32, ...]


@dataclass(frozen=True, kw_only=True)
class Domain:
    """A box of cells with its boundary conditions, ready for the solver; built by `build_domain`."""

    shape: tuple[int, int, int]
    cell_m: float
    air: Bool
    coefficients: tuple[F32, F32, F32]
    placed: tuple[PlacedPatch, ...]
    friction: WallFriction
    ghosts: tuple[GhostFaces, ...]
    lips: tuple[OpeningEdges, ...]
    is_closed: bool
    n_air: int
    n_cut_off: int

    @property
    def inlets(self) -> list[PlacedPatch]:
        """Return the inlets."""
        return [p for p in self.placed if isinstance(p.patch, Inlet)]

    @property
    def outlets(self) -> list[PlacedPatch]:
        """Return the outlets."""
        return [p for p in self.placed if isinstance(p.patch, Outlet)]

    @property
    def reference_speed_m_s(self) -> float:
        """Return the largest prescribed speed on the boundary [m/s], or 0."""
        speeds = [placed.inflow.largest_speed_m_s for placed in self.inlets if placed.inflow]
        speeds += [norm3(*p.patch.velocity_m_s) for p in self.placed if isinstance(p.patch, MovingWall)]
        return max(speeds, default=0.0)


def build_domain(free: Bool, cell_m: float, patches: Sequence[Patch], *, needs_openings: bool = True) -> Domain:
    """Check the geometry and its boundary conditions and lay them out on the staggered grid.

    Air without a path to an outlet is treated as solid: nothing drives it.

    Args:
        free: (nx, ny, nz) True is air; index order ij, the corner of cell (0, 0, 0) is the origin.
        cell_m: Edge of the cubic cells [m].
        patches: Patches on the boundary of the box; walls elsewhere.
        needs_openings: Refuse a box without inlet and outlet; otherwise only inlets without an outlet are refused.
    """
    check_grid(free, cell_m)
    shape: tuple[int, int, int] = free.shape  # pyright: ignore[reportAssignmentType]
    placed = tuple(place_patch(patch, free, cell_m) for patch in patches)
    check_kinds(placed, needs_openings=needs_openings)
    check_overlap(placed, shape)
    is_closed = not any(isinstance(p.patch, Outlet) for p in placed)
    padded_air = np.zeros(tuple(n + LOW + HIGH for n in shape), np.bool_)
    padded_air[tuple(slice(LOW, LOW + n) for n in shape)] = free
    n_free = int(np.count_nonzero(free))
    _, ny, nz = padded_air.shape
    reached = np.zeros_like(padded_air)
    flood(padded_air.ravel(), reached.ravel(), _seeds(placed, padded_air), ny * nz, nz)
    padded_air = reached
    _check_reachable(placed, padded_air)
    coefficients = _face_coefficients(padded_air, placed)
    n_air = int(np.count_nonzero(padded_air))
    return Domain(
        shape=shape,
        cell_m=float(cell_m),
        air=padded_air,
        coefficients=coefficients,
        placed=placed,
        friction=_wall_friction(padded_air, placed, coefficients),
        ghosts=find_ghosts(padded_air, coefficients),
        lips=find_opening_edges(padded_air, coefficients),
        is_closed=is_closed,
        n_air=n_air,
        n_cut_off=n_free - n_air,
    )


def check_grid(free: Bool, cell_m: float) -> None:
    """Raise FlowError unless the grid is three-dimensional, of an allowed size, and contains air."""
    if free.ndim != 3:
        raise FlowError(f"free: expected an array of shape (nx, ny, nz), was {free.shape}.")
    if not (np.isfinite(cell_m) and cell_m > 0):
        raise FlowError(f"cell_m: expected a length above 0 m, was {cell_m}.")
    if free.size > MAX_CELLS:
        raise FlowError(
            f"free: expected at most {MAX_CELLS:,} cells, was {free.size:,} ({' x '.join(map(str, free.shape))}); "
            f"solving that would take about {free.size * BYTES_PER_CELL / 1e9:,.0f} GB of memory. "
            f"Use larger cells: doubling cell_m divides it by eight."
        )
    if free.dtype != np.bool_:
        raise FlowError(f"free: expected booleans (True is air), was {free.dtype}.")
    if not free.any():
        raise FlowError("free: expected some air, was solid everywhere.")


def _seeds(placed: Sequence[PlacedPatch], air: Bool) -> NDArray[np.int64]:
    seeds = np.zeros(air.shape, np.bool_)
    for p in placed:
        if isinstance(p.patch, Outlet):
            seeds[p.layer(p.inside)] = True
    seeds &= air
    if not seeds.any():
        seeds.ravel()[np.argmax(air)] = True
    return np.flatnonzero(seeds)


def _check_reachable(placed: Sequence[PlacedPatch], air: Bool) -> None:
    for p in placed:
        if isinstance(p.patch, Inlet) and not air[p.layer(p.inside)].any():
            raise FlowError(
                f"{p.patch}: no outlet can be reached through the air behind it. "
                f"Open a way of at least one cell, or use smaller cells."
            )


def _face_coefficients(air: Bool, placed: Sequence[PlacedPatch]) -> tuple[F32, F32, F32]:
    coefficients = []
    for axis in range(3):
        open_faces = np.zeros(air.shape, np.float32)
        above: list[slice] = [slice(None)] * 3
        below: list[slice] = [slice(None)] * 3
        above[axis], below[axis] = slice(1, None), slice(None, -1)
        open_faces[tuple(above)] = air[tuple(above)] & air[tuple(below)]
        for p in placed:
            if p.axis == axis and isinstance(p.patch, Outlet):
                open_faces[p.layer(p.face)] = 2.0 * air[p.layer(p.inside)]
        coefficients.append(open_faces)
    return coefficients[0], coefficients[1], coefficients[2]


# For each of the six directions: the cells with a rubbing wall there, and that wall's velocity.
def _wall_faces(air: Bool, placed: Sequence[PlacedPatch]) -> list[tuple[int, int, Bool, dict[int, F32]]]:
    faces = []
    for axis in range(3):
        for sign in (-1, 1):
            rubs = air & ~np.roll(air, -sign, axis=axis)
            speeds: dict[int, F32] = {}
            for p in placed:
                if p.axis != axis or p.is_high != (sign > 0):
                    continue
                layer = p.layer(p.inside)
                if not isinstance(p.patch, MovingWall):
                    rubs[layer] = False
                    continue
                for component in range(3):
                    if p.patch.velocity_m_s[component] != 0:
                        speed = speeds.setdefault(component, np.zeros(air.shape, np.float32))
                        speed[layer] = p.patch.velocity_m_s[component]
            faces.append((axis, sign, rubs, speeds))
    return faces


def _wall_friction(air: Bool, placed: Sequence[PlacedPatch], coefficients: tuple[F32, F32, F32]) -> WallFriction:
    wall_faces = _wall_faces(air, placed)
    n_walls = sum((rubs.astype(np.int8) for _, _, rubs, _ in wall_faces), np.zeros(air.shape, np.int8))
    cells = np.flatnonzero(n_walls)
    number = np.full(air.size, -1, np.int32)
    number[cells] = np.arange(cells.size)
    velocity = np.zeros((cells.size, 3), np.float32)
    parts: list[list[tuple[NDArray[np.int64], NDArray[np.int32], F32]]] = [[], [], []]
    strides = (air.shape[1] * air.shape[2], air.shape[2], 1)
    for axis, _, rubs, wall_speeds in wall_faces:
        here = np.flatnonzero(rubs)
        for component in range(3):
            speed = np.zeros(here.size, np.float32)
            if component in wall_speeds:
                speed = wall_speeds[component].ravel()[here]
                velocity[number[here], component] += speed
            if component != axis:
                parts[component] += [(face, number[here], speed) for face in (here, here + strides[component])]
    velocity /= n_walls.ravel()[cells, None]
    merged = [_merged(part, coefficient) for part, coefficient in zip(parts, coefficients)]
    faces, owners, speeds = zip(*merged)
    return WallFriction(cells=cells, velocity_m_s=velocity, faces=faces, owners=owners, wall_speed_m_s=speeds)


# One list of half faces per component, open faces only, in memory order.
def _merged(
    parts: list[tuple[NDArray[np.int64], NDArray[np.int32], F32]], coefficient: F32
) -> tuple[NDArray[np.int64], NDArray[np.int32], F32]:
    faces, owners, speeds = (np.concatenate(columns) for columns in zip(*parts))
    # An outlet's face lies in one cell only, which acts on both halves.
    repeats = coefficient.ravel()[faces].astype(np.int64)
    faces, owners, speeds = (np.repeat(values, repeats) for values in (faces, owners, speeds))
    order = np.argsort(faces, kind="stable")
    return faces[order], owners[order], speeds[order]
