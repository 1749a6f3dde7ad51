"""The wind of a room by OpenFOAM: the same question and the same form of answer as the built-in solver's."""

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import FlowError
from gslcosim.flow.openfoam.case import COURANT, write_case
from gslcosim.flow.openfoam.installation import find_installation
from gslcosim.flow.openfoam.result import read_wind
from gslcosim.flow.openfoam.run import run_case
from gslcosim.flow.pressure import F32
from gslcosim.flow.solve import AIR_NU_M2_S, Turbulence
from gslcosim.flow.walls.patches import Patch


def solve_wind_openfoam(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    *,
    end_time_s: float,
    average_from_s: float | None = None,
    case_dir: Path | None = None,
    n_ranks: int = 2,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    courant: float = COURANT,
    progress: Callable[[float], None] | None = None,
) -> F32:
    """Compute the wind in a room with pimpleFoam; arguments not named here are those of `gslcosim.flow.solve_wind`.

    Args:
        free: (nx, ny, nz) True is air.
        cell_m: Edge of the cubic cells [m]; they are the cells of OpenFOAM's mesh.
        patches: Inlets of fixed velocity, outlets, moving and frictionless walls.
        end_time_s: How long the flow develops [s].
        average_from_s: Return the mean from this time on [s]; absent: the field at the end.
        case_dir: Where to write and keep the case, a new or empty folder; absent: a temporary one, removed when all
            went well.
        n_ranks: How many processes solve it.
        turbulence: k_epsilon with wall functions, smagorinsky or laminar.
        nu_m2_s: Kinematic viscosity [m2/s].
        courant: Largest Courant number of a step.
        progress: Called at each step with the fraction done, 0 to 1.

    Returns:
        (nx, ny, nz, 3) velocities at cell centres [m/s], float32, zero in solids.

    Raises:
        FlowError: there is no OpenFOAM, it cannot solve this, or it failed; the folder of a case that failed is kept.
    """
    installation = find_installation()
    folder = case_dir or Path(tempfile.mkdtemp(prefix="gslcosim-openfoam-"))
    try:
        case = write_case(
            free,
            cell_m,
            patches,
            folder,
            end_time_s=end_time_s,
            average_from_s=average_from_s,
            n_ranks=n_ranks,
            turbulence=turbulence,
            nu_m2_s=nu_m2_s,
            courant=courant,
        )
    except FlowError:
        if case_dir is None:
            shutil.rmtree(folder)
        raise
    run_case(case, installation, on_time=lambda time_s: progress and progress(min(time_s / end_time_s, 1.0)))
    velocity_m_s = read_wind(case)
    if case_dir is None:
        shutil.rmtree(folder)
    return velocity_m_s
