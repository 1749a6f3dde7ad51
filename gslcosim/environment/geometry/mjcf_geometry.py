"""The geoms of an MJCF file as parts of triangles, where MuJoCo places them."""
# MuJoCo is compiled and comes without stubs.
# pyright: reportAttributeAccessIssue=false

from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.geometry.mesh_formats import Part

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]

_N_AROUND = 32
# Half the side of a plane that MuJoCo has without end [m].
_PLANE_M = 50.0


def load_mjcf_parts(path: Path) -> list[Part]:
    """Return one part for each geom of an MJCF file, in its initial pose, in the file's unit.

    Round shapes become prisms and rings of 32 sides. A part can be addressed by the names of its geom, body, mesh and
    material.

    Raises:
        EnvironmentDataError: MuJoCo does not take the file, or it has a height field.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        found = str(error).strip().replace("\n", " ")
        raise EnvironmentDataError(
            f"{path.name}: expected MJCF that MuJoCo takes, was {found}\nFile: {path}"
        ) from error
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return [_part_of(model, data, i, path) for i in range(model.ngeom)]


def _part_of(model: mujoco.MjModel, data: mujoco.MjData, i: int, path: Path) -> Part:
    geom = model.geom(i)
    names = [geom.name, model.body(int(geom.bodyid[0])).name]
    if geom.matid[0] >= 0:
        names.append(model.material(int(geom.matid[0])).name)
    if geom.type[0] == mujoco.mjtGeom.mjGEOM_MESH:
        names.append(model.mesh(int(geom.dataid[0])).name)
    vertices, faces = _mesh_of(model, i, path)
    world_from_geom = data.geom_xmat[i].reshape(3, 3)
    return Part(
        name=geom.name or f"geom_{i}",
        names=frozenset(name for name in names if name and name != "world"),
        vertices_m=vertices @ world_from_geom.T + data.geom_xpos[i],
        faces=faces,
        rgba=tuple(round(float(channel), 6) for channel in geom.rgba),  # pyright: ignore[reportArgumentType]
    )


def _mesh_of(model: mujoco.MjModel, i: int, path: Path) -> Mesh:
    kind, size = mujoco.mjtGeom(int(model.geom_type[i])), model.geom_size[i]
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _box(size)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return _plane(size)
    if kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        radii, heights = _half_circle()
        return _turned(radii, heights, 1.0, size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0]))
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _turned(np.ones(2), np.array((-1.0, 1.0)), 1.0, np.array((size[0], size[0], size[1])))
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        radii, heights = _half_circle()
        heights = size[0] * heights + np.sign(heights) * size[1]
        return _turned(size[0] * radii, heights, size[0] + size[1], np.ones(3))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _asset(model, int(model.geom_dataid[i]))
    raise EnvironmentDataError(
        f"{path.name}: geom {i}: expected a box, plane, sphere, ellipsoid, cylinder, capsule or mesh, was "
        f"{kind.name}. Give it as a mesh.\nFile: {path}"
    )


def _box(half: NDArray[np.float64]) -> Mesh:
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in quads for face in ((a, b, c), (a, c, d))]
    return corners * half, np.array(faces, dtype=np.int64)


def _plane(half: NDArray[np.float64]) -> Mesh:
    x, y = (side if side > 0 else _PLANE_M for side in half[:2].tolist())
    return np.array([(-x, -y, 0), (x, -y, 0), (x, y, 0), (-x, y, 0)], dtype=np.float64), np.array(
        [(0, 1, 2), (0, 2, 3)]
    )


# An even number of rings, none on the equator: a capsule's two halves move apart there.
def _half_circle() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    angles = np.linspace(-np.pi / 2, np.pi / 2, _N_AROUND // 2 + 2)[1:-1]
    return np.cos(angles), np.sin(angles)


# A surface of revolution about z: rings at heights, closed by points on the axis at both ends.
def _turned(radii: NDArray[np.float64], heights: NDArray[np.float64], end: float, scale: NDArray[np.float64]) -> Mesh:
    n = _N_AROUND
    around = 2 * np.pi * np.arange(n) / n
    # As much area as the circle.
    widen = np.sqrt(2 * np.pi / n / np.sin(2 * np.pi / n))
    circle = widen * np.stack((np.cos(around), np.sin(around)), axis=1)
    rings = [
        np.column_stack((radius * circle, np.full(n, height))) for radius, height in zip(radii, heights, strict=True)
    ]
    ends = np.array(((0.0, 0.0, -end), (0.0, 0.0, end)))
    low, high = n * len(rings), n * len(rings) + 1
    faces: list[tuple[int, int, int]] = []
    for i in range(n):
        j = (i + 1) % n
        for ring in range(0, n * (len(rings) - 1), n):
            faces += [(ring + i, ring + j, ring + n + j), (ring + i, ring + n + j, ring + n + i)]
        faces += [(low, j, i), (high, low - n + i, low - n + j)]
    return np.concatenate((*rings, ends)) * scale, np.array(faces, dtype=np.int64)


def _asset(model: mujoco.MjModel, mesh: int) -> Mesh:
    first, n = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    first_face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return (
        np.asarray(model.mesh_vert[first : first + n], dtype=np.float64),
        np.asarray(model.mesh_face[first_face : first_face + n_faces], dtype=np.int64),
    )
