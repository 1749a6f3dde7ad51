"""Fields of OpenFOAM: the vectors of `U` and of the cell centres `C` in a time folder, ascii or binary.

`postProcess -func writeCellCentres` writes `C`. Only the inner cells are read, not the boundary.
"""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.data_files import check_velocities, data_error, read_content
from gslcosim.environment.exchange.wind_files_points import PointWind, wind_of_points
from gslcosim.environment.grid import Grid

VELOCITY_FILE, CENTRES_FILE = "U", "C"
_FORMAT = re.compile(rb"\bformat\s+(\w+)\s*;")
_SCALAR_BITS = re.compile(rb"\barch\s+\"[^\"]*scalar=(\d+)")
_LIST = re.compile(rb"\binternalField\s+nonuniform\s+List<vector>\s+(\d+)\s*\(")
_UNIFORM = re.compile(rb"\binternalField\s+uniform\s+\(([^)]*)\)\s*;")
# The shortest vector is `(0 0 0)`.
_LEAST_VECTOR_BYTES = 7


def is_foam_text(content: bytes) -> bool:
    """Return whether bytes are the beginning of a file of OpenFOAM."""
    return b"FoamFile" in content[:4000]


def is_time_folder(folder: Path) -> bool:
    """Return whether a folder holds OpenFOAM's velocities with the centres of their cells."""
    return (folder / VELOCITY_FILE).is_file() and (folder / CENTRES_FILE).is_file()


def read_time_folder(folder: Path, grid: Grid) -> PointWind:
    """Return the wind of `U` at the places of `C` in an OpenFOAM time folder, brought to the cells of a grid.

    Raises:
        EnvironmentDataError: a file is missing, truncated, or of another kind, they hold different numbers of cells, or
            none lies in the grid.
    """
    centres_path, velocity_path = folder / CENTRES_FILE, folder / VELOCITY_FILE
    centres_m = _vectors(centres_path)
    velocity_m_s = _vectors(velocity_path)
    if len(velocity_m_s) == 1 and len(centres_m) != 1:
        velocity_m_s = np.broadcast_to(velocity_m_s, centres_m.shape)
    if len(velocity_m_s) != len(centres_m):
        raise data_error(velocity_path, f"{len(centres_m)} vectors, as in {CENTRES_FILE}", f"{len(velocity_m_s)}")
    check_velocities(velocity_path, velocity_m_s[np.newaxis])
    return wind_of_points(velocity_path, centres_m, velocity_m_s, grid)


def _vectors(path: Path) -> NDArray[np.float64]:
    content = read_content(path)
    if not is_foam_text(content):
        raise data_error(path, "a field of OpenFOAM with its FoamFile head", "another file")
    uniform = _UNIFORM.search(content)
    if uniform is not None:
        return _numbers(path, uniform[1], 1)
    found = _LIST.search(content)
    if found is None:
        raise data_error(path, "internalField nonuniform List<vector> or uniform", "none of them")
    kind = _FORMAT.search(content)
    n = int(found[1][:20])
    is_binary = kind is not None and kind[1] == b"binary"
    return _binary(path, content, found.end(), n) if is_binary else _ascii(path, content, found.end(), n)


def _ascii(path: Path, content: bytes, start: int, n: int) -> NDArray[np.float64]:
    text = content[start : content.find(b";", start)].rstrip()
    if not text.endswith(b")") or n * _LEAST_VECTOR_BYTES > len(text):
        raise data_error(path, f"{n} vectors and a closing );", f"{len(content) - start} bytes")
    return _numbers(path, text.replace(b"(", b" ").replace(b")", b" "), n)


def _numbers(path: Path, text: bytes, n: int) -> NDArray[np.float64]:
    words = text.split()
    if len(words) != 3 * n:
        raise data_error(path, f"{n} vectors", f"{len(words)} numbers")
    try:
        values = np.array([float(word) for word in words])
    except ValueError as error:
        raise data_error(path, f"{n} vectors of numbers", str(error)) from error
    return _finite(path, values)


def _binary(path: Path, content: bytes, start: int, n: int) -> NDArray[np.float64]:
    bits = _SCALAR_BITS.search(content[:start])
    dtype = np.dtype("<f4" if bits is not None and bits[1] == b"32" else "<f8")
    end = start + 3 * n * dtype.itemsize
    if content[end : end + 1] != b")":
        raise data_error(path, f"{n} vectors of {dtype.itemsize} bytes a number and a closing )", "something else")
    return _finite(path, np.frombuffer(content, dtype, count=3 * n, offset=start).astype(np.float64))


def _finite(path: Path, values: NDArray[np.float64]) -> NDArray[np.float64]:
    if not np.isfinite(values).all() or not len(values):
        raise data_error(
            path, "finite vectors", f"{int((~np.isfinite(values)).sum())} numbers of {len(values)} that are not"
        )
    return values.reshape(-1, 3)
