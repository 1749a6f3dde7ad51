"""From a room to its wind: the functions that the rest of gslcosim and its users call."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import FlowError
from gslcosim.flow.boundary import clear_ghosts
from gslcosim.flow.domain import build_domain
from gslcosim.flow.patches import Patch
from gslcosim.flow.pressure import F32
from gslcosim.flow.pressure_kernels import HIGH, LOW
from gslcosim.flow.solver import FlowSolver, StepRecord, mass_balance
from gslcosim.flow.turbulence import Velocity, make_model, still_velocity

AIR_NU_M2_S = 1.5e-5

Turbulence = Literal["k_epsilon", "smagorinsky", "laminar"]


@dataclass(frozen=True, kw_only=True)
class WindReport:
    """A solved wind field and how well it was solved.

    Attributes:
        velocity_m_s: (nx, ny, nz, 3) at cell centres, xyz, in the grid's frame; zero in solids.
        face_velocity_m_s: x-, y- and z-faces, (nx + 1, ny, nz), (nx, ny + 1, nz), (nx, ny, nz + 1).
        k_m2_s2: (nx, ny, nz) turbulence energy at the end, for k-epsilon.
        divergence_max_per_s: Largest |div u| of a cell [1/s].
        divergence_relative: The same times cell over the largest speed on the boundary.
        inflow_m3_s: Air entering through inlets and outlets.
        outflow_m3_s: Air leaving.
        n_cut_off_cells: Air cells from which no outlet can be reached; they are still.
        history: One record per time step.
    """

    velocity_m_s: F32
    face_velocity_m_s: Velocity
    k_m2_s2: F32 | None
    divergence_max_per_s: float
    divergence_relative: float
    inflow_m3_s: float
    outflow_m3_s: float
    n_cut_off_cells: int
    history: tuple[StepRecord, ...]

    @property
    def n_steps(self) -> int:
        """Return the number of time steps."""
        return len(self.history)

    @property
    def mass_balance_relative(self) -> float:
        """Return |inflow - outflow| over inflow."""
        return abs(self.inflow_m3_s - self.outflow_m3_s) / max(self.inflow_m3_s, 1e-30)


def solve_wind(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    *,
    end_time_s: float,
    average_from_s: float | None = None,
    progress: Callable[[float], None] | None = None,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    courant: float = 0.9,
) -> F32:
    """Compute the wind in a room from its geometry, its inlets and its outlets.

    Air starts at rest; walls are wherever no patch is. See `solve_wind_report` for how well it was solved.

    Args:
        free: (nx, ny, nz) True is air; index order ij, the corner of cell (0, 0, 0) is the origin.
        cell_m: Edge of the cubic cells [m].
        patches: Inlets, outlets, moving and frictionless walls on the boundary of the box.
        end_time_s: How long the flow develops [s].
        average_from_s: Return the mean from this time on [s]; absent: the field at the end.
        progress: Called now and then with the fraction done, 0 to 1.
        turbulence: k_epsilon with wall functions, smagorinsky (large-eddy simulation) or laminar.
        nu_m2_s: Kinematic viscosity of the gas [m2/s]; air at 20 degrees by default.
        courant: Largest (|u| + |v| + |w|) dt / h of a step.

    Returns:
        (nx, ny, nz, 3) velocities at cell centres [m/s], float32, zero in solids.

    Raises:
        FlowError: the case cannot be solved, or diverged; the message says what to change.
    """
    return solve_wind_report(
        free,
        cell_m,
        patches,
        end_time_s=end_time_s,
        average_from_s=average_from_s,
        progress=progress,
        turbulence=turbulence,
        nu_m2_s=nu_m2_s,
        courant=courant,
    ).velocity_m_s


def solve_wind_report(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    *,
    end_time_s: float,
    average_from_s: float | None = None,
    progress: Callable[[float], None] | None = None,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    courant: float = 0.9,
) -> WindReport:
    """Compute the wind in a room and say how well it was solved; arguments as for `solve_wind`."""
    _check_times(end_time_s, average_from_s)
    if not 0 < courant <= 1:
        raise FlowError(f"courant: expected above 0 and at most 1, was {courant}.")
    domain = build_domain(free, cell_m, patches)
    solver = FlowSolver(domain, make_model(turbulence, domain, nu_m2_s), courant=courant)
    history, mean = _run(solver, end_time_s, average_from_s, progress)
    velocity = mean or solver.velocity
    solver.project_tightly(velocity)
    clear_ghosts(domain, velocity)
    return _report(solver, velocity, tuple(history))


def _check_times(end_time_s: float, average_from_s: float | None) -> None:
    if not (np.isfinite(end_time_s) and end_time_s > 0):
        raise FlowError(f"end_time_s: expected a time above 0 s, was {end_time_s}.")
    if average_from_s is not None and not 0 <= average_from_s < end_time_s:
        raise FlowError(
            f"average_from_s: expected from 0 to below end_time_s ({end_time_s} s), was {average_from_s} s."
        )


# Step to the end; the mean of the face velocities from `average_from_s` on, if asked for.
def _run(
    solver: FlowSolver, end_time_s: float, average_from_s: float | None, progress: Callable[[float], None] | None
) -> tuple[list[StepRecord], Velocity | None]:
    history: list[StepRecord] = []
    mean = None if average_from_s is None else still_velocity(solver.domain)
    averaged_s = 0.0
    while solver.time_s < end_time_s:
        is_averaging = average_from_s is not None and solver.time_s >= average_from_s
        until_s = end_time_s if average_from_s is None or is_averaging else average_from_s
        record = solver.step(until_s=until_s)
        history.append(record)
        if mean is not None and is_averaging:
            averaged_s += record.dt_s
            weight = np.float32(record.dt_s / averaged_s)
            for total, now in zip(mean, solver.velocity):
                total += weight * (now - total)
        if progress is not None:
            progress(min(solver.time_s / end_time_s, 1.0))
    return history, mean


def _report(solver: FlowSolver, velocity: Velocity, history: tuple[StepRecord, ...]) -> WindReport:
    domain = solver.domain
    divergence_m_s = solver.divergence_m_s(velocity)
    inflow, outflow = mass_balance(domain, velocity)
    k = getattr(solver.model, "k", None)
    return WindReport(
        velocity_m_s=solver.centre_velocity(velocity),
        face_velocity_m_s=_trimmed(velocity),
        k_m2_s2=None if k is None else k[(slice(LOW, -HIGH),) * 3].copy(),
        divergence_max_per_s=divergence_m_s / domain.cell_m,
        divergence_relative=divergence_m_s / solver.reference_speed_m_s,
        inflow_m3_s=inflow,
        outflow_m3_s=outflow,
        n_cut_off_cells=domain.n_cut_off,
        history=history,
    )


# Face velocities without their padding.
def _trimmed(velocity: Velocity) -> Velocity:
    inner, faces = slice(LOW, -HIGH), slice(LOW, -HIGH + 1)
    u, v, w = velocity
    return u[faces, inner, inner].copy(), v[inner, faces, inner].copy(), w[inner, inner, faces].copy()
