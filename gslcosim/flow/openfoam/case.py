"""A room as an OpenFOAM case: what is solved, how, and from which start."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import FlowError
from gslcosim.flow.domain import build_domain
from gslcosim.flow.openfoam import dictionary
from gslcosim.flow.openfoam.fields import fields_of
from gslcosim.flow.openfoam.polymesh import PolyMesh, polymesh_of
from gslcosim.flow.patches import Patch
from gslcosim.flow.solve import AIR_NU_M2_S, Turbulence, check_times

FIRST_STEP_S = 1e-4  # AutoGDM+'s; the Courant number decides from the second step on


# OpenFOAM's model of the same name has C^2 = C_k sqrt(C_k / C_e); with its C_e this C_k gives the built-in C of 0.12.
_SMAGORINSKY_C_K, _SMAGORINSKY_C_E = 0.0601, 1.048

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
            "SmagorinskyCoeffs": {"Ck": _SMAGORINSKY_C_K, "Ce": _SMAGORINSKY_C_E},
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
class Case:
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
    courant: float = 1.0,
) -> Case:
    check_times(end_time_s, average_from_s)
    domain = build_domain(free, cell_m, patches)
    mesh = polymesh_of(domain)
    _write_mesh(folder / "constant" / "polyMesh", mesh)
    for name, field in fields_of(domain, mesh.boundaries, turbulence).items():
        of_class = "volVectorField" if name == "U" else "volScalarField"
        dictionary.write_dictionary(folder / "0" / name, field, of_class=of_class)
    transport = {"transportModel": "Newtonian", "nu": f"[0 2 -1 0 0 0 0] {nu_m2_s!r}"}
    dictionary.write_dictionary(folder / "constant" / "transportProperties", transport)
    dictionary.write_dictionary(folder / "constant" / "turbulenceProperties", _SIMULATION[turbulence])
    dictionary.write_dictionary(folder / "system" / "fvSchemes", _SCHEMES)
    dictionary.write_dictionary(folder / "system" / "fvSolution", _SOLUTION)
    dictionary.write_dictionary(folder / "system" / "controlDict", _control(end_time_s, average_from_s, courant))
    dictionary.write_dictionary(folder / "system" / "decomposeParDict", _decomposition(n_ranks, mesh.air.shape))
    return Case(folder=folder, mesh=mesh, field="U" if average_from_s is None else "UMean", n_ranks=n_ranks)


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
