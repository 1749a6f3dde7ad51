"""A room as an OpenFOAM case: what is solved, how, and from which start."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import FlowError
from gslcosim.flow.openfoam import dictionary
from gslcosim.flow.openfoam.fields import fields_of
from gslcosim.flow.openfoam.polymesh import PolyMesh, polymesh_of
from gslcosim.flow.solve import AIR_NU_M2_S, Turbulence
from gslcosim.flow.turbulence import SMAGORINSKY_CONSTANT
from gslcosim.flow.walls.domain import build_domain
from gslcosim.flow.walls.inflow import Schedule
from gslcosim.flow.walls.patches import Inlet, MovingWall, Outlet, Patch, SlipWall

COURANT = 1.0  # AutoGDM+'s
FIRST_STEP_S = 1e-4  # AutoGDM+'s; the Courant number decides from the second step on

# The built-in model's constant in OpenFOAM's: C^2 = C_k sqrt(C_k / C_e), with OpenFOAM's C_e.
_C_E = 1.048
_C_K = (SMAGORINSKY_CONSTANT**4 * _C_E) ** (1 / 3)

_KINDS = (Inlet, Outlet, MovingWall, SlipWall)

_SIMULATION = {
    "k_epsilon": {"simulationType": "RAS", "RAS": {"RASModel": "kEpsilon", "turbulence": "on", "printCoeffs": "on"}},
    "smagorinsky": {
        "simulationType": "LES",
        "LES": {
            "LESModel": "Smagorinsky",
            "turbulence": "on",
            "printCoeffs": "on",
            "delta": "cubeRootVol",
            "cubeRootVolCoeffs": {"deltaCoeff": 1},
            "SmagorinskyCoeffs": {"Ck": _C_K, "Ce": _C_E},
        },
    },
    "laminar": {"simulationType": "laminar"},
}

_SCHEMES = {
    "ddtSchemes": {"default": "Euler"},
    "gradSchemes": {"default": "Gauss linear"},
    "divSchemes": {
        "default": "none",
        "div(phi,U)": "Gauss linearUpwind grad(U)",
        "div(phi,k)": "Gauss limitedLinear 1",
        "div(phi,epsilon)": "Gauss limitedLinear 1",
        "div((nuEff*dev2(T(grad(U)))))": "Gauss linear",
    },
    "laplacianSchemes": {"default": "Gauss linear corrected"},
    "interpolationSchemes": {"default": "linear"},
    "snGradSchemes": {"default": "corrected"},
}

_PRESSURE = {"solver": "GAMG", "smoother": "DICGaussSeidel", "tolerance": 1e-6, "relTol": 0.01}
_TRANSPORT = {"solver": "smoothSolver", "smoother": "symGaussSeidel", "tolerance": 1e-6, "relTol": 0.1}
_SOLUTION = {
    "solvers": {
        "p": _PRESSURE,
        "pFinal": {**_PRESSURE, "relTol": 0},
        '"(U|k|epsilon)"': _TRANSPORT,
        '"(U|k|epsilon)Final"': {**_TRANSPORT, "relTol": 0},
    },
    # One outer loop: pimpleFoam is then PISO.
    "PIMPLE": {"nOuterCorrectors": 1, "nCorrectors": 2, "nNonOrthogonalCorrectors": 0},
}


@dataclass(frozen=True, kw_only=True)
class FoamCase:
    """A case folder and what is needed to read its result: the mesh and the field that will be the wind."""

    folder: Path
    mesh: PolyMesh
    field: str
    n_ranks: int


def write_case(
    free: NDArray[np.bool_],
    cell_m: float,
    patches: Sequence[Patch],
    folder: Path,
    *,
    end_time_s: float,
    average_from_s: float | None = None,
    n_ranks: int = 2,
    turbulence: Turbulence = "k_epsilon",
    nu_m2_s: float = AIR_NU_M2_S,
    courant: float = COURANT,
) -> FoamCase:
    """Write a room as a case for pimpleFoam, to be run by `solve_wind_openfoam` or elsewhere.

    What is solved is what AutoGDM+ asks of pimpleFoam: one outer loop (PISO), Euler in time, the k-epsilon model with
    wall functions. Second-order upwind for the velocity, and limited central differences for k and epsilon, are
    chosen here. The mesh has the cells of the grid from which an outlet can be reached.
    To run it: `decomposePar`, then `mpirun -np 2 pimpleFoam -parallel`, in the folder.

    Args:
        free: (nx, ny, nz) True is air; index order ij, the corner of cell (0, 0, 0) is the origin.
        cell_m: Edge of the cubic cells [m].
        patches: Inlets whose velocity does not change in time, outlets, moving and frictionless walls.
        folder: A new or empty folder.
        end_time_s: How long the flow develops [s].
        average_from_s: Let OpenFOAM average the velocity from this time on [s] (its field UMean).
        n_ranks: Into how many parts decomposePar is to cut the mesh.
        turbulence: k_epsilon with wall functions, smagorinsky or laminar.
        nu_m2_s: Kinematic viscosity [m2/s].
        courant: Largest Courant number of a step.

    Raises:
        FlowError: the room cannot be solved, or not by this; the message says what to change.
    """
    _check(patches, folder, turbulence, n_ranks, courant)
    _check_times(end_time_s, average_from_s)
    domain = build_domain(free, cell_m, patches)
    mesh = polymesh_of(domain)
    _write_mesh(folder / "constant" / "polyMesh", mesh)
    for name, field in fields_of(domain, mesh.boundaries, turbulence).items():
        of_class = "volVectorField" if name == "U" else "volScalarField"
        dictionary.write_dictionary(folder / "0" / name, field, of_class=of_class)
    transport = {"transportModel": "Newtonian", "nu": f"[0 2 -1 0 0 0 0] {float(nu_m2_s)!r}"}
    dictionary.write_dictionary(folder / "constant" / "transportProperties", transport)
    dictionary.write_dictionary(folder / "constant" / "turbulenceProperties", _SIMULATION[turbulence])
    dictionary.write_dictionary(folder / "system" / "fvSchemes", _SCHEMES)
    dictionary.write_dictionary(folder / "system" / "fvSolution", _SOLUTION)
    dictionary.write_dictionary(folder / "system" / "controlDict", _control(end_time_s, average_from_s, courant))
    dictionary.write_dictionary(folder / "system" / "decomposeParDict", _decomposition(n_ranks, mesh.air.shape))
    return FoamCase(folder=folder, mesh=mesh, field="U" if average_from_s is None else "UMean", n_ranks=n_ranks)


def _check(patches: Sequence[Patch], folder: Path, turbulence: str, n_ranks: int, courant: float) -> None:
    for patch in patches:
        _check_kind(patch)
    if turbulence not in _SIMULATION:
        raise FlowError(f"turbulence: expected one of {', '.join(_SIMULATION)}, was {turbulence!r}.")
    if n_ranks < 1:
        raise FlowError(f"n_ranks: expected at least 1 process, was {n_ranks}.")
    if not courant > 0:
        raise FlowError(f"courant: expected above 0, was {courant}.")
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise FlowError(f"the folder of the case: expected a new or an empty one, found something in it: {folder}")


def _check_times(end_time_s: float, average_from_s: float | None) -> None:
    if not (np.isfinite(end_time_s) and end_time_s > 0):
        raise FlowError(f"end_time_s: expected a time above 0 s, was {end_time_s}.")
    if average_from_s is not None and not 0 <= average_from_s < end_time_s:
        raise FlowError(
            f"average_from_s: expected from 0 to below end_time_s ({end_time_s} s), was {average_from_s} s."
        )


def _check_kind(patch: Patch) -> None:
    if type(patch) not in _KINDS:
        names = ", ".join(kind.__name__ for kind in _KINDS)
        raise FlowError(
            f"{patch}: expected one of {names} for OpenFOAM, was {type(patch).__name__}. Use the built-in solver."
        )
    if isinstance(patch, Inlet) and (patch.factor is not None or isinstance(patch.velocity_m_s, Schedule)):
        raise FlowError(
            f"{patch}: expected a velocity that does not change in time for OpenFOAM, found a schedule. "
            f"Use the built-in solver."
        )


def _write_mesh(folder: Path, mesh: PolyMesh) -> None:
    note = f"nPoints: {len(mesh.points_m)} nCells: {mesh.n_cells} nFaces: {len(mesh.faces)} "
    note += f"nInternalFaces: {len(mesh.neighbours)}"
    dictionary.write_points(folder / "points", mesh.points_m)
    dictionary.write_faces(folder / "faces", mesh.faces)
    dictionary.write_labels(folder / "owner", mesh.owners, note=note)
    dictionary.write_labels(folder / "neighbour", mesh.neighbours, note=note)
    boundaries = {
        b.name: {"type": "wall" if b.is_wall else "patch", "nFaces": b.n_faces, "startFace": b.first_face}
        for b in mesh.boundaries
    }
    dictionary.write_boundary(folder / "boundary", boundaries)


def _control(end_time_s: float, average_from_s: float | None, courant: float) -> dict[str, Any]:
    entries = {
        "application": "pimpleFoam",
        "startFrom": "startTime",
        "startTime": 0,
        "stopAt": "endTime",
        "endTime": end_time_s,
        "deltaT": FIRST_STEP_S,
        "adjustTimeStep": True,
        "maxCo": courant,
        "writeControl": "adjustableRunTime",
        "writeInterval": end_time_s,
        "writeFormat": "ascii",
        "writePrecision": 8,
        "timePrecision": 8,
        "runTimeModifiable": False,
    }
    if average_from_s is None:
        return entries
    mean = {
        "type": "fieldAverage",
        "libs": ('"libfieldFunctionObjects.so"',),
        "timeStart": average_from_s,
        "writeControl": "writeTime",
        "fields": "( U { mean on; prime2Mean off; base time; } )",
    }
    return {**entries, "functions": {"mean": mean}}


# Slices of equal numbers of cells across the longest side; `scotch` cuts better but Debian's OpenFOAM lacks it.
def _decomposition(n_ranks: int, shape: tuple[int, ...]) -> dict[str, Any]:
    longest = shape.index(max(shape))
    parts = tuple(n_ranks if axis == longest else 1 for axis in range(3))
    return {"numberOfSubdomains": n_ranks, "method": "simple", "simpleCoeffs": {"n": parts, "delta": 0.001}}
