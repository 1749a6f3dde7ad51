"""Export of an environment: GADEN, GSL-Bench, VTK, NetCDF, Zarr, OpenFOAM points, STL and MJCF."""

import argparse
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pyevtk.hl import imageToVTK
from pyevtk.vtk import VtkGroup

from gslcosim.environment.export_folder import ExportResult, build_file_name, create_export_folder
from gslcosim.environment.model import Box, Cell, Environment
from gslcosim.scenario import Scenario
from gslcosim_formats.data_files import (
    BINARY_MARK,
    OCCUPANCY_FILE,
    cells_in_order,
    format_occupancy,
    format_rows,
)
from gslcosim_formats.datasets import GriddedFormat, build_environment_dataset, write_dataset
from gslcosim_formats.environment_folders import GRID_SUFFIX, HEAD_SUFFIX, OCCUPANCY_DIR, WIND_DIR
from gslcosim_formats.scene_file import SCENE_FILE, build_mjcf

# Corners 0 to 7 are x, y, z low or high, in binary; triangles turn left seen from outside.
_BOX_FACES = np.array(
    [
        face
        for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        for face in ((a, b, c), (a, c, d))
    ]
)
Format = Literal["gaden", "gsl_bench", "vtk", GriddedFormat, "stl", "openfoam_points", "mjcf"]
GadenWind = Literal["components", "components_text", "points", "iterations"]
FORMATS: tuple[Format, ...] = get_args(Format)
GADEN_WINDS: tuple[GadenWind, ...] = get_args(GadenWind)
_GADEN_POINTS = '"U:0","U:1","U:2","Points:0","Points:1","Points:2"'
_FOAM_POINTS = "x,y,z,Ux,Uy,Uz"
# Nine digits name a float32 exactly.
_EXACT = "%.9g"


def build_stl(environment: Environment) -> bytes:
    """Return an environment as STL text in metres, z upwards: one solid with its name for each element.

    Elements are the boxes, the walls that close the room included; where there are meshes, they stand for the
    obstacles, and the boxes made from them are left out. Openings are closed.
    """
    return b"".join(_solid(name, corners_m) for name, corners_m in _elements(environment))


def _elements(environment: Environment) -> Iterator[tuple[str, NDArray[np.float64]]]:
    for box in environment.boxes:
        if not environment.meshes or box.kind != "obstacle":
            yield box.name, _corners_of(box)[_BOX_FACES]
    for mesh in environment.meshes:
        yield mesh.name, mesh.vertices_m.astype(np.float64)[mesh.faces]


def _corners_of(box: Box) -> NDArray[np.float64]:
    ends = np.array((box.min_m, box.max_m))
    return np.array([(ends[i, 0], ends[j, 1], ends[k, 2]) for i in (0, 1) for j in (0, 1) for k in (0, 1)])


def _solid(name: str, corners_m: NDArray[np.float64]) -> bytes:
    normals = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.where(lengths > 0, lengths, 1.0)
    values = np.concatenate((normals, corners_m.reshape(-1, 9)), axis=1)
    facet = "facet normal %.6g %.6g %.6g\nouter loop\n" + 3 * "vertex %.9g %.9g %.9g\n" + "endloop\nendfacet\n"
    label = " ".join(name.split())
    return (
        f"solid {label}\n" + "".join(facet % tuple(row) for row in values.tolist()) + f"endsolid {label}\n"
    ).encode()


def write_vtk(environment: Environment, folder: Path, name: str) -> tuple[Path, ...]:
    """Write `<name>_i.vti` for each frame of wind, and `<name>.pvd`, which has them in time.

    Each file holds, for every cell: `wind` [m/s], `speed` [m/s], and `occupancy` as in `Cell`.

    Args:
        environment: What to write.
        folder: Where; it is there.
        name: What the files' names begin with.

    Returns:
        The files, the series last.
    """
    series = VtkGroup(str(folder / name))
    files: list[Path] = []
    for i, velocity_m_s in enumerate(environment.wind.velocity_m_s):
        files.append(Path(_write_frame(environment, velocity_m_s, folder / f"{name}_{i}")))
        series.addFile(filepath=str(files[-1]), sim_time=i * environment.wind.period_s)
    series.save()
    return (*files, folder / f"{name}.pvd")


def _write_frame(environment: Environment, velocity_m_s: NDArray[np.float32], path: Path) -> str:
    cell_data = {
        "wind": tuple(np.ascontiguousarray(velocity_m_s[..., axis]) for axis in range(3)),
        "speed": np.linalg.norm(velocity_m_s, axis=-1),
        "occupancy": np.ascontiguousarray(environment.occupancy),
    }
    grid = environment.grid
    return imageToVTK(str(path), origin=grid.origin_m, spacing=(grid.cell_m,) * 3, cellData=cell_data)


def write_environment(
    environment: Environment, folder: Path, scenario: Scenario | None, arguments: argparse.Namespace
) -> ExportResult:
    """Write an environment with the options of `gslcosim environment export`; see `export_environment`."""
    del scenario
    return export_environment(environment, folder, arguments.to, gaden_wind=arguments.gaden_wind)


def export_environment(
    environment: Environment, folder: Path, to: Format, *, gaden_wind: GadenWind = "components"
) -> ExportResult:
    """Write an environment in another program's format.

    Occupancy and wind come back the same when they are read again; the wind in GADEN's and GSL-Bench's formats is that
    of all cells, in tables of points that of air cells.

    Args:
        environment: What to write.
        folder: Where; a new folder or an empty one.
        to: The format.
        gaden_wind: How GADEN gets the wind: binary or text `components` as its simulator of versions 1 and 2 reads
            them, `points` as its preprocessing reads them, or `iterations` as its results and version 3 have them.
    """
    create_export_folder(folder)
    name = build_file_name(environment.name)
    if to == "gaden":
        return _to_gaden(environment, folder, name, gaden_wind)
    if to == "gsl_bench":
        return _to_gsl_bench(environment, folder, name)
    if to == "vtk":
        return ExportResult(files=write_vtk(environment, folder, name))
    if to in ("netcdf", "zarr"):
        return ExportResult(files=(write_dataset(build_environment_dataset(environment), folder, name, to),))
    if to == "openfoam_points":
        return ExportResult(files=_write_points(environment, folder, "U", _FOAM_POINTS, is_place_first=True))
    if to == "stl":
        return ExportResult(files=(_written(folder / f"{name}.stl", build_stl(environment)),))
    return ExportResult(files=(_written(folder / SCENE_FILE, build_mjcf(environment).encode()),))


def _written(path: Path, content: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def _to_gaden(environment: Environment, folder: Path, name: str, wind: GadenWind) -> ExportResult:
    wind_dir = folder / "wind" if wind == "iterations" else folder / "wind_simulations" / name
    wind_dir.mkdir(parents=True)
    files = (
        _written(folder / OCCUPANCY_FILE, format_occupancy(environment.grid, environment.occupancy).encode()),
        _written(folder / "cad_models" / f"{name}.stl", build_stl(environment)),
        *_GADEN_WRITERS[wind](environment, wind_dir),
    )
    return ExportResult(files=files, notices=(_timing(environment, "GADEN", "wind_time_step and allow_looping"),))


def _to_gsl_bench(environment: Environment, folder: Path, name: str) -> ExportResult:
    grid = environment.grid
    head = {"env_min": grid.origin_m, "env_max": grid.max_m, "num_cells": grid.shape, "cell_size": grid.cell_m}
    occupancy_dir, wind_path = folder / OCCUPANCY_DIR, folder / WIND_DIR / f"{name}.npy"
    head_path = _written(occupancy_dir / f"{name}{HEAD_SUFFIX}", json.dumps(head).encode())
    grid_path = occupancy_dir / f"{name}{GRID_SUFFIX}"
    np.save(grid_path, np.ascontiguousarray(np.moveaxis(environment.occupancy, 2, 0), dtype=np.int64))
    wind_path.parent.mkdir()
    frames = environment.wind.velocity_m_s
    cells = np.lib.format.open_memmap(wind_path, "w+", np.float64, (len(frames), environment.occupancy.size, 3))
    for i, frame in enumerate(frames):
        cells[i] = cells_in_order(frame)
    cells.flush()
    notice = _timing(environment, "GSL-Bench", "wind_data_time_step of its anemometer")
    return ExportResult(files=(head_path, grid_path, wind_path), notices=(notice,))


def _timing(environment: Environment, program: str, setting: str) -> str:
    wind = environment.wind
    if len(wind.velocity_m_s) == 1:
        return f"{program} is not told of inlets; the wind is steady."
    loops = "loops" if wind.is_looping else "does not loop"
    return (
        f"{program}'s files hold neither inlets nor timing: frames are {wind.period_s:g} s apart and the wind {loops}; "
        f"set {setting}."
    )


def _write_components(environment: Environment, folder: Path) -> tuple[Path, ...]:
    mark = np.int32(BINARY_MARK).tobytes()
    return tuple(
        _written(folder / f"wind_{i}.csv_{letter}", mark + cells_in_order(frame[..., axis]).astype("<f8").tobytes())
        for i, frame in enumerate(environment.wind.velocity_m_s)
        for axis, letter in enumerate("UVW")
    )


def _write_text_components(environment: Environment, folder: Path) -> tuple[Path, ...]:
    return tuple(
        _written(folder / f"wind_{i}.csv_{letter}", format_rows(frame[..., axis], _EXACT).encode())
        for i, frame in enumerate(environment.wind.velocity_m_s)
        for axis, letter in enumerate("UVW")
    )


def _write_iterations(environment: Environment, folder: Path) -> tuple[Path, ...]:
    version = np.array([3, 0], "<i4").tobytes()
    return tuple(
        _written(folder / f"wind_iteration_{i}", version + cells_in_order(frame).astype("<f4").tobytes())
        for i, frame in enumerate(environment.wind.velocity_m_s)
    )


def _write_gaden_points(environment: Environment, folder: Path) -> tuple[Path, ...]:
    return _write_points(environment, folder, "wind", _GADEN_POINTS, is_place_first=False)


_GADEN_WRITERS: dict[GadenWind, Callable[[Environment, Path], tuple[Path, ...]]] = {
    "components": _write_components,
    "components_text": _write_text_components,
    "points": _write_gaden_points,
    "iterations": _write_iterations,
}


# The centres of the air cells with their wind, one file a frame.
def _write_points(
    environment: Environment, folder: Path, name: str, header: str, *, is_place_first: bool
) -> tuple[Path, ...]:
    is_air = environment.occupancy != Cell.SOLID
    places_m = environment.grid.centres_m()[is_air]
    files = (folder / f"{name}_{i}.csv" for i in range(len(environment.wind.velocity_m_s)))
    return tuple(
        _written(path, _points_text(header, places_m, frame[is_air], is_place_first=is_place_first).encode())
        for path, frame in zip(files, environment.wind.velocity_m_s, strict=True)
    )


def _points_text(
    header: str, places_m: NDArray[np.float64], velocity_m_s: NDArray[np.float32], *, is_place_first: bool
) -> str:
    values = np.hstack([places_m, velocity_m_s] if is_place_first else [velocity_m_s, places_m])
    line = ",".join([_EXACT] * 6) + "\n"
    return f"{header}\n" + (line * len(values)) % tuple(values.ravel().tolist())
