"""Reading what OpenFOAM computed: fields in text, in one piece or in one part per rank."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.errors import FlowError
from gslcosim.flow.openfoam.case import FoamCase

F32 = NDArray[np.float32]


def read_wind(case: FoamCase) -> F32:
    """Return the wind of a case that has been run, (nx, ny, nz, 3) at cell centres [m/s], zero in solids.

    Raises:
        FlowError: the result is missing or not as it was asked for; says which file.
    """
    cells = np.full((case.mesh.n_cells, 3), np.nan)
    for part in _parts(case):
        values = _read_vectors(_last_time(part) / case.field)
        cells[_cell_numbers(part, len(values))] = values
    if not np.isfinite(cells).all():
        raise FlowError(
            f"{case.folder}: expected a finite {case.field} in every cell, was missing or infinite in some."
        )
    velocity_m_s = np.zeros((*case.mesh.air.shape, 3), np.float32)
    velocity_m_s[case.mesh.air] = cells
    return velocity_m_s


def _parts(case: FoamCase) -> list[Path]:
    parts = [case.folder / f"processor{rank}" for rank in range(case.n_ranks)]
    return parts if case.n_ranks > 1 else [case.folder]


def _last_time(part: Path) -> Path:
    times = {float(path.name): path for path in part.iterdir() if re.fullmatch(r"[0-9.]+(e[+-]?\d+)?", path.name)}
    latest = max(times, default=0.0)
    if latest <= 0:
        raise FlowError(f"{part}: expected a folder named by the end of the solve [s], found none.")
    return times[latest]


# Which cells of the whole mesh the rows of a part are.
def _cell_numbers(part: Path, n: int) -> NDArray[np.int64]:
    path = part / "constant" / "polyMesh" / "cellProcAddressing"
    return _read_numbers(path, r"\n(\d+)\s*\(", np.int64) if path.is_file() else np.arange(n)


def _read_vectors(path: Path) -> NDArray[np.float64]:
    return _read_numbers(path, r"internalField\s+nonuniform\s+List<vector>\s+(\d+)\s*\(", np.float64, width=3)


# The list of numbers after its length, which `opening` finds, in text; parentheses around vectors are left out.
def _read_numbers(path: Path, opening: str, dtype: type, *, width: int = 1) -> NDArray:
    if not path.is_file():
        raise FlowError(f"{path}: expected OpenFOAM to have written it, was missing.")
    text = path.read_text(encoding="ascii", errors="replace")
    match = re.search(opening, text)
    if match is None:
        raise FlowError(f"{path}: expected a list in text (writeFormat ascii), found none.")
    n = int(match[1])
    end = text.find(")\n)" if width > 1 else ")", match.end())
    body = text[match.end() : end]
    numbers = np.fromstring(body.translate({ord("("): " ", ord(")"): " "}), dtype=dtype, sep=" ")
    if numbers.size != n * width:
        raise FlowError(f"{path}: expected {n * width} numbers, found {numbers.size}.")
    return numbers if width == 1 else numbers.reshape(n, width)
