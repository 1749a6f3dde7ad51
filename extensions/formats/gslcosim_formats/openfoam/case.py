"""OpenFOAM case of an environment: mesh, equations, numerics, initial fields and boundary conditions."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import FlowError
from gslcosim.flow.domain import Bool, Domain, PlacedPatch, build_domain
from gslcosim.flow.patches import Inlet, MovingWall, Outlet, Patch, Schedule, SlipWall
from gslcosim.flow.pressure import F32, HIGH, LOW
from gslcosim.flow.solve import AIR_NU_M2_S, Turbulence
from gslcosim.flow.turbulence import SMAGORINSKY_CONSTANT, inlet_turbulence, start_turbulence

Int = NDArray[np.int64]

WALLS = "walls"
Entries = Mapping[str, Any]
Condition = Mapping[str, Any]
Level = Mapping[str, float]  # k and epsilon
_ZERO_GRADIENT = {"type": "zeroGradient"}
_CALCULATED = {"type": "calculated", "value": "uniform 0"}
_SLIP = {"type": "slip"}
_DIMENSIONS = {
    "U": "[0 1 -1 0 0 0 0]",
    "p": "[0 2 -2 0 0 0 0]",
    "k": "[0 2 -2 0 0 0 0]",
    "epsilon": "[0 2 -3 0 0 0 0]",
    "nut": "[0 2 -1 0 0 0 0]",
}
_FIELDS = {
    "k_epsilon": ("U", "p", "k", "epsilon", "nut"),
    "rng_k_epsilon": ("U", "p", "k", "epsilon", "nut"),
    "smagorinsky": ("U", "p", "nut"),
    "laminar": ("U", "p"),
}
COURANT = 1.0  # AutoGDM+'s
FIRST_STEP_S = 1e-4  # AutoGDM+'s; the Courant number decides from the second step on
# The built-in model's constant in OpenFOAM's: C^2 = C_k sqrt(C_k / C_e), with OpenFOAM's C_e.
_C_E = 1.048
_C_K = (SMAGORINSKY_CONSTANT**4 * _C_E) ** (1 / 3)
_KINDS = (Inlet, Outlet, MovingWall, SlipWall)
_SIMULATION = {
    "k_epsilon": {"simulationType": "RAS", "RAS": {"RASModel": "kEpsilon", "turbulence": "on", "printCoeffs": "on"}},
    "rng_k_epsilon": {
        "simulationType": "RAS",
        "RAS": {"RASModel": "RNGkEpsilon", "turbulence": "on", "printCoeffs": "on"},
    },
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


def write_dictionary(path: Path, entries: Entries, *, of_class: str = "dictionary") -> None:
    """Write entries as an OpenFOAM dictionary; a mapping in them becomes a dictionary of its own.

    Booleans become yes and no, tuples lists in parentheses, numbers their shortest exact form; other values are text.
    """
    _write(path, of_class, "\n".join(_lines(entries)))


def write_boundary(path: Path, boundaries: Mapping[str, Entries]) -> None:
    """Write the list of boundaries of a mesh."""
    body = "\n".join(_lines(boundaries))
    _write(path, "polyBoundaryMesh", f"{len(boundaries)}\n(\n{body}\n)")


def write_labels(path: Path, labels: NDArray[np.int64], *, note: str) -> None:
    """Write whole numbers, one a line; `note` is what OpenFOAM's tools show of the file."""
    _write_list(path, "labelList", map(str, labels.tolist()), len(labels), note=note)


def write_faces(path: Path, faces: NDArray[np.int64]) -> None:
    """Write faces of four points each, (n, 4)."""
    _write_list(path, "faceList", (f"4({a} {b} {c} {d})" for a, b, c, d in faces.tolist()), len(faces))


def write_points(path: Path, points_m: NDArray[np.float64]) -> None:
    """Write points (n, 3) [m]."""
    _write_list(path, "vectorField", (f"({x:.9g} {y:.9g} {z:.9g})" for x, y, z in points_m.tolist()), len(points_m))


def _write_list(path: Path, of_class: str, items: Iterable[str], n: int, *, note: str = "") -> None:
    _write(path, of_class, f"{n}\n(\n" + "\n".join(items) + "\n)", note=note)


def _write(path: Path, of_class: str, body: str, *, note: str = "") -> None:
    header = {"version": "2.0", "format": "ascii", "class": of_class, "object": path.name}
    if note:
        header["note"] = f'"{note}"'
    path.parent.mkdir(parents=True, exist_ok=True)
    head = "\n".join(_lines({"FoamFile": header}))
    path.write_text(f"{head}\n\n{body}\n", encoding="ascii")


def _lines(entries: Entries, indent: str = "") -> Iterable[str]:
    for key, value in entries.items():
        if isinstance(value, Mapping):
            yield from (f"{indent}{key}", f"{indent}{{", *_lines(value, f"{indent}    "), f"{indent}}}")
        else:
            yield f"{indent}{key} {_text(value)};"


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return f"({' '.join(_text(item) for item in value)})"
    return repr(value) if isinstance(value, float) else str(value)


def build_fields(domain: Domain, boundaries: tuple[Boundary, ...], turbulence: str) -> dict[str, dict[str, Any]]:
    """Return the start of each field that a turbulence model needs, by OpenFOAM's name.

    Air is still; k and epsilon are those that the built-in solver starts with, everywhere.
    """
    start = _level(*start_turbulence(domain))
    return {
        name: {
            "dimensions": _DIMENSIONS[name],
            "internalField": "uniform (0 0 0)" if name == "U" else f"uniform {start.get(name, 0.0)!r}",
            "boundaryField": {b.name: _condition(name, b, domain, start, turbulence) for b in boundaries},
        }
        for name in _FIELDS[turbulence]
    }


def _condition(field: str, boundary: Boundary, domain: Domain, start: Level, turbulence: str) -> Condition:
    if boundary.placed is None:
        return _at_wall(field, (0.0, 0.0, 0.0), start, turbulence)
    patch = boundary.placed.patch
    if isinstance(patch, MovingWall):
        return _at_wall(field, patch.velocity_m_s, start, turbulence)
    if isinstance(patch, SlipWall):
        return _CALCULATED if field == "nut" else _SLIP
    if isinstance(patch, Outlet):
        return _at_outlet(field, start)
    assert isinstance(patch, Inlet), "write_case refuses other kinds"
    level = _level(*inlet_turbulence(boundary.placed, domain))
    return _at_inlet(field, _inlet_velocities(boundary.placed, domain), level)


def _at_wall(field: str, velocity_m_s: tuple[float, float, float], start: Level, turbulence: str) -> Condition:
    if field == "U":
        return _fixed(velocity_m_s)
    if field == "p":
        return _ZERO_GRADIENT
    if field == "nut":
        # Without a turbulence energy the wall's friction follows from the speed beside it alone.
        function = "nutkWallFunction" if turbulence in ("k_epsilon", "rng_k_epsilon") else "nutUSpaldingWallFunction"
        return {"type": function, "value": "uniform 0"}
    function = {"k": "kqRWallFunction", "epsilon": "epsilonWallFunction"}[field]
    return {"type": function, "value": f"uniform {start[field]!r}"}


def _at_outlet(field: str, start: Level) -> Condition:
    if field == "p":
        return {"type": "fixedValue", "value": "uniform 0"}
    if field == "U":
        return {"type": "pressureInletOutletVelocity", "value": "uniform (0 0 0)"}
    if field == "nut":
        return _CALCULATED
    inside = f"uniform {start[field]!r}"
    return {"type": "inletOutlet", "inletValue": inside, "value": inside}


def _at_inlet(field: str, velocities_m_s: F32, level: Level) -> Condition:
    if field == "U":
        first = velocities_m_s[0]
        return _fixed(first) if (velocities_m_s == first).all() else _fixed_each(velocities_m_s)
    if field == "p":
        return _ZERO_GRADIENT
    if field == "nut":
        return _CALCULATED
    return {"type": "fixedValue", "value": f"uniform {level[field]!r}"}


def _level(k_m2_s2: float, epsilon_m2_s3: float) -> Level:
    return {"k": float(k_m2_s2), "epsilon": float(epsilon_m2_s3)}


# (n, 3) velocities of the inlet's faces, in the order of the mesh: that of their cells.
def _inlet_velocities(placed: PlacedPatch, domain: Domain) -> F32:
    assert placed.inflow is not None, "inlets have one"
    return placed.inflow.profile_m_s[domain.air[placed.layer(placed.inside)]]


def _fixed(velocity_m_s: Iterable[float]) -> Condition:
    return {"type": "fixedValue", "value": f"uniform {_vector(velocity_m_s)}"}


def _fixed_each(velocities_m_s: F32) -> Condition:
    vectors = " ".join(_vector(velocity) for velocity in velocities_m_s)
    return {"type": "fixedValue", "value": f"nonuniform List<vector> {len(velocities_m_s)}({vectors})"}


def _vector(components: Iterable[float]) -> str:
    return f"({' '.join(f'{component:.9g}' for component in components)})"


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
        turbulence: k_epsilon or rng_k_epsilon with wall functions, smagorinsky or laminar.
        nu_m2_s: Kinematic viscosity [m2/s].
        courant: Largest Courant number of a step.
    """
    _check(patches, folder, turbulence, n_ranks, courant)
    _check_times(end_time_s, average_from_s)
    domain = build_domain(free, cell_m, patches)
    mesh = build_polymesh(domain)
    _write_mesh(folder / "constant" / "polyMesh", mesh)
    for name, field in build_fields(domain, mesh.boundaries, turbulence).items():
        of_class = "volVectorField" if name == "U" else "volScalarField"
        write_dictionary(folder / "0" / name, field, of_class=of_class)
    transport = {"transportModel": "Newtonian", "nu": f"[0 2 -1 0 0 0 0] {float(nu_m2_s)!r}"}
    write_dictionary(folder / "constant" / "transportProperties", transport)
    write_dictionary(folder / "constant" / "turbulenceProperties", _SIMULATION[turbulence])
    write_dictionary(folder / "system" / "fvSchemes", _SCHEMES)
    write_dictionary(folder / "system" / "fvSolution", _SOLUTION)
    write_dictionary(folder / "system" / "controlDict", _control(end_time_s, average_from_s, courant))
    write_dictionary(folder / "system" / "decomposeParDict", _decomposition(n_ranks, mesh.air.shape))
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
        raise FlowError(f"The folder of the case is not empty: {folder}. Choose a new or empty folder.")


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
    write_points(folder / "points", mesh.points_m)
    write_faces(folder / "faces", mesh.faces)
    write_labels(folder / "owner", mesh.owners, note=note)
    write_labels(folder / "neighbour", mesh.neighbours, note=note)
    boundaries = {
        b.name: {"type": "wall" if b.is_wall else "patch", "nFaces": b.n_faces, "startFace": b.first_face}
        for b in mesh.boundaries
    }
    write_boundary(folder / "boundary", boundaries)


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
