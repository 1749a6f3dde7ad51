"""STL of an environment: what vehicles, gas and sight meet, for other programs."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.model import Box, Environment

# Corners 0 to 7 are x, y, z low or high, in binary; triangles turn left seen from outside.
_BOX_FACES = np.array(
    [
        face
        for a, b, c, d in ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        for face in ((a, b, c), (a, c, d))
    ]
)


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
