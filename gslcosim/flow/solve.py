"""Wind of an environment: the functions that the rest of gslcosim and its users call, with a coarse start."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.flow.buoyancy import Buoyancy, BuoyantScalar
from gslcosim.flow.convergence import (
    WIND_TOLERANCE_FRAC,
    ConvergenceMonitor,
    ConvergenceResult,
    FrameRecorder,
    MeanRecorder,
    settling_window_s,
)
from gslcosim.flow.domain import Domain, build_domain
from gslcosim.flow.patches import Inlet, Patch, PlacedPatch
from gslcosim.flow.pressure import F32, HIGH, LOW
from gslcosim.flow.report import WindReport
from gslcosim.flow.solver import FlowSolver, StepRecord, clear_ghosts, mass_balance
from gslcosim.flow.turbulence import KEpsilon, Velocity, make_model, still_velocity

# With fewer cells a flow from still air develops in seconds of computing; chosen.
LEAST_CELLS = 30_000
# Number of windows that cover the start of a flow and the two that are compared: enough to start from still air.
N_WINDOWS_FROM_STILL = 3.0
# Shortest limit, in windows, of a solve that heat drives: its layers form over several turnovers of the air; chosen.
N_WINDOWS_OF_HEAT = 16.0
# Longest start over the time that follows; chosen: it then costs a third of that.
LONGEST_START = 5.0
_INNER = (slice(LOW, -HIGH),) * 3
_Number = TypeVar("_Number", bound=np.generic)
AIR_NU_M2_S = 1.5e-5
MAX_TIME_S = 600.0
# Fraction of the progress bar for a start on coarse cells; chosen.
START_SHARE = 0.2
Turbulence = Literal["k_epsilon", "rng_k_epsilon", "smagorinsky", "laminar"]


@dataclass(frozen=True, kw_only=True)
class SolverNumerics:
    """Numerical settings of a solve, independent of its cells; see `solve_wind_report`."""

    turbulence: str
    nu_m2_s: float
    courant: float
    max_step_s: float = math.inf
    buoyancy: BuoyantScalar | None = None

    def solver(self, domain: Domain, *, initial_velocity: Velocity | None = None) -> FlowSolver:
        """Return a solver for a domain, whose air is still unless padded face velocities [m/s] are given."""
        return FlowSolver(
            domain,
            make_model(self.turbulence, domain, self.nu_m2_s),
            courant=self.courant,
            max_step_s=self.max_step_s,
            initial_velocity=initial_velocity,
            buoyancy=None if self.buoyancy is None else Buoyancy(domain, self.buoyancy),
        )


def develop_on_coarse_cells(
    domain: Domain, numerics: SolverNumerics, *, max_time_s: float, progress: Callable[[float], None] | None = None
) -> FlowSolver | None:
    """Solve the start of a flow on cells of twice the size, until its energy no longer changes.

    Args:
        domain: The domain on the room's own cells.
        max_time_s: Time limit of the solve on the room's own cells [s].
        progress: Called with the fraction of the longest start that is over.

    Returns:
        The solver in its state at that time. None if a coarse start has no advantage or is impossible: few cells, time
        enough for a flow from still air to settle, inlets that change, air or openings without a representation on
        larger cells, a flow that diverges on them.
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
    """Return a solver on cells of half the size with the flow of another solver; its time restarts at 0."""
    fine = numerics.solver(domain, initial_velocity=spread_velocity(coarse, domain))
    transfer_state(coarse, fine)
    return fine


def coarsen_domain(domain: Domain) -> Domain | None:
    """Return a domain on cells of twice the size; None where its openings do not fit them or air no longer passes.

    A coarse cell is air when more than half of it is, so that walls one cell thick stay closed. Where the number of
    cells is odd, the last ones are continued. An inlet that loses cells at its rim gets the speed that preserves its
    momentum flux, which drives the air of a room.
    """
    fine = domain.air[_INNER]
    shape = tuple((n + 1) // 2 for n in domain.shape)
    even = np.pad(fine, [(0, 2 * half - n) for half, n in zip(shape, domain.shape, strict=True)], mode="edge")
    nx, ny, nz = shape
    n_air = even.reshape(nx, 2, ny, 2, nz, 2).sum(axis=(1, 3, 5))
    try:
        patches = [_coarsened_patch(placed, shape, domain.cell_m) for placed in domain.placed]
        coarse = build_domain(n_air > 4, 2 * domain.cell_m, patches, needs_openings=not domain.is_closed)
        gains = [max(1.0, math.sqrt(a.n_cells / (4 * b.n_cells))) for a, b in zip(domain.placed, coarse.placed)]
        if all(gain == 1 for gain, patch in zip(gains, patches) if isinstance(patch, Inlet)):
            return coarse
        patches = [
            replace(patch, velocity_m_s=gain * np.asarray(patch.velocity_m_s)) if isinstance(patch, Inlet) else patch
            for gain, patch in zip(gains, patches)
        ]
        return build_domain(n_air > 4, 2 * domain.cell_m, patches, needs_openings=not domain.is_closed)
    except FlowError:
        return None


# Borders between cells of the coarse grid stay in place, others move up by one cell, on both sides alike.
def _coarsened_patch(placed: PlacedPatch, shape: tuple[int, ...], cell_m: float) -> Patch:
    at_m = 2 * cell_m * shape[placed.axis] if placed.is_high else 0.0
    ends_m = [(2 * cell_m * ((row.start + 1) // 2), 2 * cell_m * ((row.stop + 1) // 2)) for row in placed.rows]
    ends_m.insert(placed.axis, (at_m, at_m))
    corners = {"min_m": tuple(low for low, _ in ends_m), "max_m": tuple(high for _, high in ends_m)}
    if not isinstance(placed.patch, Inlet):
        return replace(placed.patch, **corners)
    assert placed.inflow is not None
    fine_m_s = placed.inflow.at(0.0)
    # A coarse cell that is half covered by the opening takes the covered half as a whole.
    a, b = (
        np.clip(np.arange(2 * ((row.start + 1) // 2), 2 * ((row.stop + 1) // 2)) - row.start, 0, n - 1)
        for row, n in zip(placed.rows, fine_m_s.shape[:2], strict=True)
    )
    velocity_m_s = fine_m_s[a][:, b].reshape(len(a) // 2, 2, len(b) // 2, 2, 3).mean(axis=(1, 3))
    return replace(placed.patch, **corners, velocity_m_s=velocity_m_s)


def spread_velocity(coarse: FlowSolver, domain: Domain) -> Velocity:
    """Return a flow on cells of half the size, padded face velocities [m/s].

    Between two coarse faces a velocity changes linearly along itself and not across: where the coarse flow is
    divergence-free, the fine one is too. Faces of inlets are left to the solver.
    """
    known, velocity = _without_divergence(coarse), still_velocity(domain)
    for axis in range(3):
        faces = tuple(slice(LOW, -HIGH + (1 if other == axis else 0)) for other in range(3))
        open_faces = domain.coefficients[axis][faces] > 0
        values = np.repeat(known[axis][faces], 2, axis=axis)
        # Means of neighbours; the mean of a face and itself is the face.
        below, above = np.moveaxis(values, axis, 0)[:-1], np.moveaxis(values, axis, 0)[1:]
        values = np.moveaxis(np.float32(0.5) * (below + above), 0, axis)
        for other in range(3):
            if other != axis:
                values = np.repeat(values, 2, axis=other)
        velocity[axis][faces] = np.where(
            open_faces, values[tuple(slice(0, n) for n in open_faces.shape)], np.float32(0)
        )
    return velocity


# A copy of the flow in the form of a result: still in obstacles, projected tightly.
def _without_divergence(solver: FlowSolver) -> Velocity:
    u, v, w = (component.copy() for component in solver.velocity)
    solver.project_tightly((u, v, w))
    clear_ghosts(solver.domain, (u, v, w))
    return u, v, w


def transfer_state(coarse: FlowSolver, fine: FlowSolver) -> None:
    """Copy the pressure and the turbulence of a flow to a solver on cells of half the size; see `spread_velocity`."""
    is_known = _spread(coarse.domain.air, fine.domain.shape) & fine.domain.air[_INNER]
    fine.pressure[_INNER] = np.where(is_known, _spread(coarse.pressure, fine.domain.shape), np.float32(0))
    if isinstance(fine.model, KEpsilon) and isinstance(coarse.model, KEpsilon):
        k, epsilon = fine.model.k.copy(), fine.model.epsilon.copy()
        for values, known in ((k, coarse.model.k), (epsilon, coarse.model.epsilon)):
            values[_INNER] = np.where(is_known, _spread(known, fine.domain.shape), values[_INNER])
        fine.model.set_turbulence(k, epsilon)


# Padded values of coarse cells on the fine cells within them, without padding.
def _spread(values: NDArray[_Number], shape: tuple[int, ...]) -> NDArray[_Number]:
    inner = values[_INNER]
    for axis in range(3):
        inner = np.repeat(inner, 2, axis=axis)
    return inner[tuple(slice(0, n) for n in shape)]


class _Observer(Protocol):
    # Observer of the flow after every step; steps end at `next_stop_s`.
    def next_stop_s(self, time_s: float) -> float: ...

    def see(self, solver: FlowSolver, record: StepRecord) -> None: ...


def solve_wind(free: NDArray[np.bool_], cell_m: float, patches: Sequence[Patch], **settings: Any) -> F32:
    """Compute the wind in a room from its geometry, its inlets and its outlets.

    Args:
        free: As for `solve_wind_report`, like all other arguments.
        cell_m: Edge of the cubic cells [m].
        patches: Patches on the boundary of the box.

    Returns:
        (nx, ny, nz, 3) velocities at cell centres [m/s], float32, zero in solids.
    """
    return solve_wind_report(free, cell_m, patches, **settings).velocity_m_s


def solve_wind_report(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    *,
    end_time_s: float | None = None,
    average_from_s: float | None = None,
    progress: Callable[[float], None] | None = None,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    courant: float = 0.9,
    max_time_s: float = MAX_TIME_S,
    settle_tolerance_frac: float = WIND_TOLERANCE_FRAC,
    save_every_s: float | None = None,
    save_from_s: float = 0.0,
    max_step_s: float | None = None,
    buoyancy: BuoyantScalar | None = None,
) -> WindReport:
    """Compute the wind in a room from its geometry, its inlets and its outlets, with a report of the solution.

    The air starts at rest; without an end time, in halls, it starts with a flow that was developed on larger cells
    (`develop_on_coarse_cells`). Walls are wherever there is no patch.

    Args:
        free: (nx, ny, nz) True is air; index order ij, the corner of cell (0, 0, 0) is the origin.
        cell_m: Edge of the cubic cells [m].
        patches: Inlets, outlets, moving and frictionless walls on the boundary of the box.
        end_time_s: Duration of the flow [s]; absent: until its statistics have settled, and the wind returned is the
            mean over the last two windows of time compared (see `convergence.ConvergenceMonitor`).
        average_from_s: Return the mean from this time on [s]; absent: the field at the end. Only with an end time.
        progress: Called now and then with the fraction done, 0 to 1.
        turbulence: k_epsilon or rng_k_epsilon with wall functions, smagorinsky (large-eddy simulation) or laminar.
        nu_m2_s: Kinematic viscosity of the gas [m2/s]; air at 20 degrees by default.
        courant: Largest (|u| + |v| + |w|) dt / h of a step.
        max_time_s: Without an end time: limit of the wait for the statistics to settle [s]; the report states whether
            it was reached. The time on larger cells is not counted. With buoyancy at least `N_WINDOWS_OF_HEAT` windows.
        settle_tolerance_frac: Without an end time: largest change of the mean wind from window to window (root mean
            square).
        save_every_s: Interval of stored frames of the wind [s]; absent: none.
        save_from_s: Time of the first frame [s].
        max_step_s: Largest time step, regardless of the Courant number [s].
        buoyancy: Gas or heat that the wind carries and that drives it, in a box that may have no inlet.
    """
    _check_times(end_time_s, average_from_s, max_time_s, settle_tolerance_frac)
    if not 0 < courant <= 1:
        raise FlowError(f"courant: expected above 0 and at most 1, was {courant}.")
    if max_step_s is not None and not max_step_s > 0:
        raise FlowError(f"max_step_s: expected a time above 0 s, was {max_step_s}.")
    if not (np.isfinite(nu_m2_s) and nu_m2_s > 0):
        raise FlowError(f"nu_m2_s: expected a viscosity above 0 m2/s, was {nu_m2_s}; air has {AIR_NU_M2_S}.")
    domain = build_domain(free, cell_m, patches, needs_openings=buoyancy is None)
    driven_m_s = 0.0 if buoyancy is None else Buoyancy(domain, buoyancy).turnover_m_s
    if buoyancy is not None:
        max_time_s = max(max_time_s, N_WINDOWS_OF_HEAT * settling_window_s(domain, driven_m_s))
    limit_s = max_time_s if end_time_s is None else end_time_s
    numerics = SolverNumerics(
        turbulence=turbulence,
        nu_m2_s=nu_m2_s,
        courant=courant,
        max_step_s=max_step_s or math.inf,
        buoyancy=buoyancy,
    )
    watch = mean = frames = coarse = None
    if end_time_s is None:
        if save_every_s is None and buoyancy is None:
            start_progress = _share_of(progress, 0.0, START_SHARE)
            coarse = develop_on_coarse_cells(domain, numerics, max_time_s=max_time_s, progress=start_progress)
        progress = _share_of(progress, 0.0 if coarse is None else START_SHARE, 1.0)
        watch = ConvergenceMonitor(
            domain,
            tolerance_frac=settle_tolerance_frac,
            coarse_start_s=0.0 if coarse is None else coarse.time_s,
            max_time_s=max_time_s,
            driven_m_s=driven_m_s,
        )
    elif average_from_s is not None:
        mean = MeanRecorder(domain, average_from_s)
    if save_every_s is not None:
        frames = FrameRecorder(domain, save_every_s=save_every_s, save_from_s=save_from_s, end_s=limit_s)
    solver = numerics.solver(domain) if coarse is None else continue_on_fine_cells(coarse, domain, numerics)
    if frames is not None:
        frames.start(solver)
    history = _run(solver, limit_s, watch, [o for o in (watch, mean, frames) if o is not None], progress)
    velocity, settling = (solver.velocity if mean is None else mean.velocity), None
    if watch is not None:
        velocity, settling = watch.result()
    solver.project_tightly(velocity)
    clear_ghosts(domain, velocity)
    return _report(solver, velocity, tuple(history), settling, frames)


# Progress of a part of the work, reported as a fraction of the whole.
def _share_of(progress: Callable[[float], None] | None, low: float, high: float) -> Callable[[float], None] | None:
    return progress and (lambda fraction: progress(low + (high - low) * fraction))


def _check_times(
    end_time_s: float | None, average_from_s: float | None, max_time_s: float, settle_tolerance_frac: float
) -> None:
    for name, time_s in (("end_time_s", end_time_s), ("max_time_s", max_time_s)):
        if time_s is not None and not (np.isfinite(time_s) and time_s > 0):
            raise FlowError(f"{name}: expected a time above 0 s, was {time_s}.")
    if not 0 < settle_tolerance_frac < 1:
        raise FlowError(f"settle_tolerance_frac: expected between 0 and 1, was {settle_tolerance_frac}.")
    if average_from_s is None:
        return
    if end_time_s is None:
        raise FlowError("average_from_s: expected to be absent, as end_time_s is: the settled windows are averaged.")
    if not 0 <= average_from_s < end_time_s:
        raise FlowError(
            f"average_from_s: expected from 0 to below end_time_s ({end_time_s} s), was {average_from_s} s."
        )


# Step to the end, or until the flow has settled.
def _run(
    solver: FlowSolver,
    limit_s: float,
    watch: ConvergenceMonitor | None,
    observers: Sequence[_Observer],
    progress: Callable[[float], None] | None,
) -> list[StepRecord]:
    history: list[StepRecord] = []
    while solver.time_s < limit_s and not (watch is not None and watch.has_settled):
        record = solver.step(until_s=min([limit_s, *(o.next_stop_s(solver.time_s) for o in observers)]))
        history.append(record)
        for observer in observers:
            observer.see(solver, record)
        if progress is not None:
            is_over = watch is not None and watch.has_settled
            progress(1.0 if is_over else min(solver.time_s / limit_s, 1.0))
    solver.check()
    return history


def _report(
    solver: FlowSolver,
    velocity: Velocity,
    history: tuple[StepRecord, ...],
    settling: ConvergenceResult | None,
    frames: FrameRecorder | None,
) -> WindReport:
    domain = solver.domain
    divergence_m_s = solver.divergence_m_s(velocity)
    inflow, outflow = mass_balance(domain, velocity)
    model = solver.model if isinstance(solver.model, KEpsilon) else None
    inner, faces = slice(LOW, -HIGH), slice(LOW, -HIGH + 1)
    u, v, w = velocity
    return WindReport(
        velocity_m_s=solver.centre_velocity(velocity),
        face_velocity_m_s=(u[faces, inner, inner].copy(), v[inner, faces, inner].copy(), w[inner, inner, faces].copy()),
        k_m2_s2=None if model is None else model.k[_INNER].copy(),
        epsilon_m2_s3=None if model is None else model.epsilon[_INNER].copy(),
        divergence_max_per_s=divergence_m_s / domain.cell_m,
        divergence_relative=divergence_m_s / solver.reference_speed_m_s,
        inflow_m3_s=inflow,
        outflow_m3_s=outflow,
        n_air_cells=domain.n_air,
        n_cut_off_cells=domain.n_cut_off,
        history=history,
        settling=settling,
        scalar=None if solver.buoyancy is None else solver.buoyancy.values[_INNER].copy(),
        scalar_by_height=None if solver.buoyancy is None else solver.buoyancy.column_mean(),
        frames_m_s=None if frames is None else frames.frames_m_s,
        frame_times_s=None if frames is None else frames.times_s,
    )
