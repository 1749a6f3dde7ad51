"""CSV files of points to sample, and of sampled values."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.files import open_regular_file

COORDINATES = ("x_m", "y_m", "z_m")


def read_points(path: Path) -> NDArray[np.float64]:
    """Return the (m, 3) points of a csv file with a header that names x_m, y_m and z_m, world frame [m].

    Further columns are passed over.
    """
    try:
        with io.TextIOWrapper(open_regular_file(path), encoding="utf-8-sig", newline="") as file:
            rows = [(number, row) for number, row in enumerate(csv.reader(file, strict=True), 1) if any(row)]
    except OSError as error:
        raise _error(path, "a csv file that can be read", str(error.strerror)) from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise _error(path, "a csv file that can be read", str(error)) from error
    header = [name.strip() for name in rows[0][1]] if rows else []
    missing = [name for name in COORDINATES if header.count(name) != 1]
    if missing:
        raise _error(path, f"a header line with {', '.join(COORDINATES)}", ", ".join(header) or "an empty file")
    columns = [header.index(name) for name in COORDINATES]
    if len(rows) == 1:
        raise _error(path, "at least one point below the header", "none")
    return np.array([_point(path, number, row, len(header), columns) for number, row in rows[1:]])


def write_values(path: Path, points_m: NDArray[np.float64], names: Sequence[str], values: NDArray[np.float64]) -> None:
    """Write a csv file: the points, then the values, each number so that reading it back gives the same double.

    Args:
        path: Where to.
        points_m: (m, 3) points, world frame [m].
        names: Of the k columns of values.
        values: (m, k).
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join((*COORDINATES, *names)) + "\n")
        for row in np.hstack([points_m, values]).tolist():
            file.write(",".join(map(repr, row)) + "\n")


def _point(path: Path, number: int, row: list[str], n_columns: int, columns: list[int]) -> list[float]:
    if len(row) != n_columns:
        raise _error(path, f"{n_columns} values in line {number}, as in the header", f"{len(row)}")
    try:
        point = [float(row[column]) for column in columns]
    except ValueError as error:
        raise _error(path, f"numbers in line {number}", ",".join(row)) from error
    if not np.isfinite(point).all():
        raise _error(path, f"finite numbers in line {number}", ",".join(row))
    return point


def _error(path: Path, expected: str, found: str) -> UsageError:
    return UsageError(f"--points: expected {expected}, was {found}.\nFile: {path}")
