"""Report of a wind solve: wind, steps, mass balance, history and convergence."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.flow.convergence import ConvergenceResult
from gslcosim.flow.pressure import F32
from gslcosim.flow.solver import StepRecord
from gslcosim.flow.turbulence import Velocity

_STEP_COLUMNS = (
    "time_s",
    "dt_s",
    "courant",
    "max_speed_m_s",
    "max_viscosity_m2_s",
    "kinetic_energy_m2_s2",
    "inflow_m3_s",
    "outflow_m3_s",
)


@dataclass(frozen=True, kw_only=True)
class WindReport:
    """A solved wind field and the quality of the solution.

    Attributes:
        velocity_m_s: (nx, ny, nz, 3) at cell centres, xyz, in the grid's frame; zero in solids.
        face_velocity_m_s: x-, y- and z-faces, (nx + 1, ny, nz), (nx, ny + 1, nz), (nx, ny, nz + 1).
        k_m2_s2: (nx, ny, nz) turbulence energy at the end, for k-epsilon.
        epsilon_m2_s3: (nx, ny, nz) its dissipation at the end.
        divergence_max_per_s: Largest |div u| of a cell [1/s].
        divergence_relative: `divergence_max_per_s` times cell edge over the largest speed on the boundary.
        inflow_m3_s: Air that enters through inlets and outlets.
        outflow_m3_s: Air that leaves.
        n_air_cells: Cells in which the flow was solved.
        n_cut_off_cells: Air cells without a path to an outlet; their air is at rest.
        history: One record per time step.
        settling: Convergence of the statistics; absent when an end time was given.
        scalar: (nx, ny, nz) the scalar that drives the wind at the end, of a solve with buoyancy: the volume fraction
            of a gas, or the temperature excess over the air [K].
        scalar_by_height: (nz,) its mean over the air at each height.
        frames_m_s: (t, nx, ny, nz, 3) frames at cell centres, each divergence-free; absent unless requested.
        frame_times_s: (t,) their times [s].
    """

    velocity_m_s: F32
    face_velocity_m_s: Velocity
    k_m2_s2: F32 | None
    epsilon_m2_s3: F32 | None
    divergence_max_per_s: float
    divergence_relative: float
    inflow_m3_s: float
    outflow_m3_s: float
    n_air_cells: int
    n_cut_off_cells: int
    history: tuple[StepRecord, ...]
    settling: ConvergenceResult | None = None
    scalar: F32 | None = None
    scalar_by_height: NDArray[np.float64] | None = None
    frames_m_s: F32 | None = None
    frame_times_s: NDArray[np.float64] | None = None

    @property
    def n_steps(self) -> int:
        """Return the number of time steps."""
        return len(self.history)

    @property
    def mass_balance_relative(self) -> float:
        """Return |inflow - outflow| over inflow."""
        return abs(self.inflow_m3_s - self.outflow_m3_s) / max(self.inflow_m3_s, 1e-30)

    def history_columns(self) -> dict[str, list[float]]:
        """Return the history as one list per quantity, units in the names, for tables and plots."""
        columns = {name: [float(getattr(r, name)) for r in self.history] for name in _STEP_COLUMNS}
        columns["pressure_iterations"] = [r.pressure.iterations for r in self.history]
        columns["divergence_before_m_s"] = [r.pressure.first_max_m_s for r in self.history]
        columns["divergence_after_m_s"] = [r.pressure.last_max_m_s for r in self.history]
        return columns

    def summary(self) -> dict[str, Any]:
        """Return the figures of the quality of the solution, ready for `json.dump`."""
        speed_m_s = np.linalg.norm(self.velocity_m_s, axis=-1)
        iterations = [r.pressure.iterations for r in self.history]
        return {
            "shape": list(self.velocity_m_s.shape[:3]),
            "n_air_cells": self.n_air_cells,
            "n_cut_off_cells": self.n_cut_off_cells,
            "end_time_s": self.history[-1].time_s,
            "n_steps": self.n_steps,
            "largest_courant": max(r.courant for r in self.history),
            "mean_pressure_iterations": float(np.mean(iterations)),
            "divergence_max_per_s": self.divergence_max_per_s,
            "divergence_relative": self.divergence_relative,
            "inflow_m3_s": self.inflow_m3_s,
            "outflow_m3_s": self.outflow_m3_s,
            "mass_balance_relative": self.mass_balance_relative,
            "max_speed_m_s": float(speed_m_s.max()),
            "mean_speed_m_s": float(speed_m_s.sum(dtype=np.float64) / self.n_air_cells),
            "n_frames": 0 if self.frames_m_s is None else len(self.frames_m_s),
            "settling": None if self.settling is None else self.settling.summary(),
            **({} if self.scalar_by_height is None else {"scalar_by_height": self.scalar_by_height.tolist()}),
        }
