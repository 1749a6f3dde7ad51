"""OpenFOAM's text format: dictionaries, lists, and the header of each file."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Entries = Mapping[str, Any]


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
