"""Coarse start: a developed flow solved on cells of twice the size, where a second of flow costs a sixteenth."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.flow.boundaries.domain import Domain, build_domain
from gslcosim.flow.boundaries.padding import clear_ghosts
from gslcosim.flow.boundaries.patches import Inlet, Patch
from gslcosim.flow.boundaries.placement import PlacedPatch
from gslcosim.flow.convergence import WIND_TOLERANCE_FRAC, ConvergenceMonitor, settling_window_s
from gslcosim.flow.pressure import HIGH, LOW
from gslcosim.flow.solver import FlowSolver
from gslcosim.flow.turbulence import KEpsilon, Velocity, make_model, still_velocity

# Below so many cells a flow from still air develops in seconds of computing; chosen.
LEAST_CELLS = 30_000
# So many windows hold the start of a flow and the two that are compared: time enough to start from still air.
N_WINDOWS_FROM_STILL = 3.0
# A start may last so many times as long as what follows; chosen: it then costs a third of that.
LONGEST_START = 5.0
_INNER = (slice(LOW, -HIGH),) * 3
_Number = TypeVar("_Number", bound=np.generic)


@dataclass(frozen=True, kw_only=True)
class SolverNumerics:
    """Numerical settings of a solve, on whichever cells; see `solve_wind_report`."""

    turbulence: str
    nu_m2_s: float
    courant: float
    max_step_s: float = math.inf

    def solver(self, domain: Domain, *, initial_velocity: Velocity | None = None) -> FlowSolver:
        """Return a solver for a domain, whose air is still unless it begins with padded face velocities [m/s]."""
        model = make_model(self.turbulence, domain, self.nu_m2_s)
        return FlowSolver(
            domain, model, courant=self.courant, max_step_s=self.max_step_s, initial_velocity=initial_velocity
        )


def develop_on_coarse_cells(
    domain: Domain, numerics: SolverNumerics, *, max_time_s: float, progress: Callable[[float], None] | None = None
) -> FlowSolver | None:
    """Solve the start of a flow on cells of twice the size, until its energy no longer changes.

    Args:
        domain: The domain on the room's own cells.
        numerics: How to solve.
        max_time_s: How long the flow will be solved on the room's own cells at most [s].
        progress: Called with the share of the longest start that is over.

    Returns:
        The solver as it is then; nothing where it is not worth it or not possible: few cells, time enough for a flow
        from still air to settle, inlets that change, an air or openings that larger cells do not hold, a flow that
        diverges on them.
    """
    is_steady = all(p.inflow and p.inflow.factor is None and p.inflow.velocity is None for p in domain.inlets)
    is_long = domain.n_air >= LEAST_CELLS and max_time_s < N_WINDOWS_FROM_STILL * settling_window_s(domain)
    coarse_domain = coarsen_domain(domain) if is_steady and is_long else None
    if coarse_domain is None:
        return None
    longest_s = LONGEST_START * max_time_s
    watch, solver = (
        ConvergenceMonitor(coarse_domain, tolerance_frac=WIND_TOLERANCE_FRAC),
        numerics.solver(coarse_domain),
    )
    try:
        while solver.time_s < longest_s and not watch.has_developed:
            record = solver.step(until_s=min(longest_s, watch.next_stop_s(solver.time_s)))
            watch.see(solver, record)
            if progress is not None:
                progress(solver.time_s / longest_s)
        solver.check()
    except FlowError:
        return None
    return solver


def continue_on_fine_cells(coarse: FlowSolver, domain: Domain, numerics: SolverNumerics) -> FlowSolver:
    """Return a solver on cells of half the size whose flow is that of another; its time begins again."""
    fine = numerics.solver(domain, initial_velocity=spread_velocity(coarse, domain))
    transfer_state(coarse, fine)
    return fine


def coarsen_domain(domain: Domain) -> Domain | None:
    """Return a domain on cells of twice the size; nothing where its openings do not fit them or air no longer passes.

    A cell of two in each direction is air when more than half of it is, so that walls one cell thick stay closed.
    Where the number of cells is odd, the last ones are continued.
    """
    fine = domain.air[_INNER]
    shape = tuple((n + 1) // 2 for n in domain.shape)
    even = np.pad(fine, [(0, 2 * half - n) for half, n in zip(shape, domain.shape, strict=True)], mode="edge")
    nx, ny, nz = shape
    n_air = even.reshape(nx, 2, ny, 2, nz, 2).sum(axis=(1, 3, 5))
    try:
        patches = [_coarsened_patch(placed, shape, domain.cell_m) for placed in domain.placed]
        return build_domain(n_air > 4, 2 * domain.cell_m, patches, needs_openings=not domain.is_closed)
    except FlowError:
        return None


# Borders between cells of the coarse grid stay where they are, others move up by a cell, both sides' alike.
def _coarsened_patch(placed: PlacedPatch, shape: tuple[int, ...], cell_m: float) -> Patch:
    at_m = 2 * cell_m * shape[placed.axis] if placed.is_high else 0.0
    ends_m = [(2 * cell_m * ((row.start + 1) // 2), 2 * cell_m * ((row.stop + 1) // 2)) for row in placed.rows]
    ends_m.insert(placed.axis, (at_m, at_m))
    corners = {"min_m": tuple(low for low, _ in ends_m), "max_m": tuple(high for _, high in ends_m)}
    if not isinstance(placed.patch, Inlet):
        return replace(placed.patch, **corners)
    assert placed.inflow is not None
    fine_m_s = placed.inflow.at(0.0)
    # Of a coarse cell that the opening covers half, the half is continued.
    a, b = (
        np.clip(np.arange(2 * ((row.start + 1) // 2), 2 * ((row.stop + 1) // 2)) - row.start, 0, n - 1)
        for row, n in zip(placed.rows, fine_m_s.shape[:2], strict=True)
    )
    velocity_m_s = fine_m_s[a][:, b].reshape(len(a) // 2, 2, len(b) // 2, 2, 3).mean(axis=(1, 3))
    return replace(placed.patch, **corners, velocity_m_s=velocity_m_s)


def spread_velocity(coarse: FlowSolver, domain: Domain) -> Velocity:
    """Return a flow on cells of half the size, padded face velocities [m/s].

    Between two coarse faces a velocity changes linearly along itself and not across: where the coarse flow neither
    gains nor loses air, the fine one does not either. Faces of inlets are left to the solver.
    """
    known, velocity = _without_divergence(coarse), still_velocity(domain)
    for axis in range(3):
        faces = tuple(slice(LOW, -HIGH + (1 if other == axis else 0)) for other in range(3))
        open_faces = domain.coefficients[axis][faces] > 0
        values = np.repeat(known[axis][faces], 2, axis=axis)
        # Means of neighbours: those of a face and itself are the face.
        below, above = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        values = np.moveaxis(np.float32(0.5) * (below + above), 0, axis)
        for other in range(3):
            if other != axis:
                values = np.repeat(values, 2, axis=other)
        velocity[axis][faces] = np.where(
            open_faces, values[tuple(slice(0, n) for n in open_faces.shape)], np.float32(0)
        )
    return velocity


# A copy of the flow as it is given to others: still in obstacles, projected tightly.
def _without_divergence(solver: FlowSolver) -> Velocity:
    u, v, w = (component.copy() for component in solver.velocity)
    solver.project_tightly((u, v, w))
    clear_ghosts(solver.domain, (u, v, w))
    return u, v, w


def transfer_state(coarse: FlowSolver, fine: FlowSolver) -> None:
    """Give a solver on cells of half the size the pressure and the turbulence of a flow; see `spread_velocity`."""
    is_known = _spread(coarse.domain.air, fine.domain.shape) & fine.domain.air[_INNER]
    fine.pressure[_INNER] = np.where(is_known, _spread(coarse.pressure, fine.domain.shape), np.float32(0))
    if isinstance(fine.model, KEpsilon) and isinstance(coarse.model, KEpsilon):
        k, epsilon = fine.model.k.copy(), fine.model.epsilon.copy()
        for values, known in ((k, coarse.model.k), (epsilon, coarse.model.epsilon)):
            values[_INNER] = np.where(is_known, _spread(known, fine.domain.shape), values[_INNER])
        fine.model.set_turbulence(k, epsilon)


# Padded values of coarse cells on the cells within, without padding.
def _spread(values: NDArray[_Number], shape: tuple[int, ...]) -> NDArray[_Number]:
    inner = values[_INNER]
    for axis in range(3):
        inner = np.repeat(inner, 2, axis=axis)
    return inner[tuple(slice(0, n) for n in shape)]
