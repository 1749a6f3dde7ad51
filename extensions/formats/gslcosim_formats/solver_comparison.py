"""Comparison of two winds in one environment, and of both solvers with their times."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ShapeError
from gslcosim.flow.patches import Patch
from gslcosim.flow.pressure import F32
from gslcosim.flow.solve import AIR_NU_M2_S, Turbulence, solve_wind
from gslcosim_formats.openfoam import find_installation, solve_wind_openfoam


@dataclass(frozen=True, kw_only=True)
class FieldSimilarity:
    """Similarity of two fields a and b over the air's cells.

    Attributes:
        correlation: Pearson's, of all values; of a velocity: of all components of all cells.
        rms_relative: sqrt(mean (a - b)^2 / mean b^2), so b is the reference.
        bias: Mean of a - b, in the fields' unit.
        rms_a: Root mean square of a, in the fields' unit.
        rms_b: Same of b.
    """

    correlation: float
    rms_relative: float
    bias: float
    rms_a: float
    rms_b: float


@dataclass(frozen=True, kw_only=True)
class WindAgreement(FieldSimilarity):
    """Agreement of two winds: all components together, each component, and the speed."""

    components: tuple[FieldSimilarity, FieldSimilarity, FieldSimilarity]
    speed: FieldSimilarity


@dataclass(frozen=True, kw_only=True)
class SolverComparison:
    """The same room by both solvers; `agreement` takes OpenFOAM's wind for the reference."""

    built_in_m_s: F32
    openfoam_m_s: F32
    built_in_wall_s: float
    openfoam_wall_s: float
    n_ranks: int
    agreement: WindAgreement

    @property
    def text(self) -> str:
        """Return the figures as lines for people."""
        rows = (("wind", self.agreement), *zip("uvw", self.agreement.components), ("speed", self.agreement.speed))
        table = [
            f"{name:5s}  {row.correlation:11.4f}  {row.rms_relative:11.4f}  {row.rms_a:13.4f}  {row.rms_b:13.4f}"
            for name, row in rows
        ]
        return "\n".join(
            [
                f"built-in solver: {self.built_in_wall_s:.1f} s; pimpleFoam: {self.openfoam_wall_s:.1f} s "
                f"with {self.n_ranks} {'rank' if self.n_ranks == 1 else 'ranks'}; "
                f"{self.openfoam_wall_s / self.built_in_wall_s:.1f} times as long",
                "       correlation   rel. diff.  built-in rms   pimpleFoam rms [m/s]",
                *table,
            ]
        )


def compare_winds(a_m_s: NDArray[np.floating], b_m_s: NDArray[np.floating], free: NDArray[np.bool_]) -> WindAgreement:
    """Say how alike two winds of a room are; the second is the reference.

    Args:
        a_m_s: (nx, ny, nz, 3) velocities [m/s].
        b_m_s: Same.
        free: (nx, ny, nz) True is air: solids do not count.
    """
    for name, array in (("a_m_s", a_m_s), ("b_m_s", b_m_s)):
        if array.shape != (*free.shape, 3):
            raise ShapeError(f"{name}: expected shape {(*free.shape, 3)}, that of free and 3, was {array.shape}")
    a, b = a_m_s[free].astype(np.float64), b_m_s[free].astype(np.float64)
    u, v, w = (_likeness(a[:, axis], b[:, axis]) for axis in range(3))
    speed = _likeness(np.linalg.norm(a, axis=-1), np.linalg.norm(b, axis=-1))
    return WindAgreement(**vars(_likeness(a.ravel(), b.ravel())), components=(u, v, w), speed=speed)


def _likeness(a: NDArray[np.float64], b: NDArray[np.float64]) -> FieldSimilarity:
    rms_a, rms_b = (float(np.sqrt(np.mean(values**2))) for values in (a, b))
    spread = float(a.std() * b.std())
    covariance = float(np.mean((a - a.mean()) * (b - b.mean())))
    rms_difference = float(np.sqrt(np.mean((a - b) ** 2)))
    return FieldSimilarity(
        correlation=covariance / spread if spread > 0 else float("nan"),
        rms_relative=rms_difference / rms_b if rms_b > 0 else float("nan"),
        bias=float(np.mean(a - b)),
        rms_a=rms_a,
        rms_b=rms_b,
    )


def compare_solvers(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    *,
    end_time_s: float,
    average_from_s: float | None = None,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    n_ranks: int = 2,
    case_dir: Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> SolverComparison:
    """Solve a room by the built-in solver and by OpenFOAM, and compare wind and time.

    Args:
        free: As for `solve_wind`, like all that is not named here.
        cell_m: Edge of the cubic cells [m].
        patches: What both solvers know; see `solve_wind_openfoam`.
        end_time_s: How long the flow develops [s].
        average_from_s: Compare means from this time on [s]; absent: the fields at the end.
        turbulence: Model of both.
        nu_m2_s: Kinematic viscosity [m2/s].
        n_ranks: Processes of OpenFOAM; the built-in solver has one.
        case_dir: Where to keep OpenFOAM's case; absent: nowhere.
        progress: Called now and then with the fraction done, 0 to 1; each solver counts as one half.
    """
    find_installation()
    tell = progress or _ignore
    times = {"end_time_s": end_time_s, "average_from_s": average_from_s}
    start_s = time.perf_counter()
    built_in_m_s = solve_wind(
        free, cell_m, patches, **times, turbulence=turbulence, nu_m2_s=nu_m2_s, progress=lambda done: tell(done / 2)
    )
    middle_s = time.perf_counter()
    openfoam_m_s = solve_wind_openfoam(
        free,
        cell_m,
        patches,
        **times,
        turbulence=turbulence,
        nu_m2_s=nu_m2_s,
        n_ranks=n_ranks,
        case_dir=case_dir,
        progress=lambda done: tell(0.5 + done / 2),
    )
    end_s = time.perf_counter()
    return SolverComparison(
        built_in_m_s=built_in_m_s,
        openfoam_m_s=openfoam_m_s,
        built_in_wall_s=middle_s - start_s,
        openfoam_wall_s=end_s - middle_s,
        n_ranks=n_ranks,
        agreement=compare_winds(built_in_m_s, openfoam_m_s, free),
    )


def _ignore(_fraction: float) -> None:
    pass
