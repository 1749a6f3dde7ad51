# pyright: reportAttributeAccessIssue=false
"""Files of geometry as named parts of triangles: STL, OBJ, glTF, and MJCF where MuJoCo places its geoms."""

import contextlib
import html
import itertools
import re
import struct
import warnings
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError, describe_os_error
from gslcosim.base.files import check_regular_file, open_regular_file, read_regular_file

Up = Literal["y", "z"]

# What points up in a file; glTF's standard says y, the others have none, and their tools mostly z.
DEFAULT_UP: dict[str, Up] = {".stl": "z", ".obj": "z", ".glb": "y", ".gltf": "y", ".xml": "z"}
PART_RGBA = (0.62, 0.62, 0.64, 1.0)
Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]
_N_AROUND = 32
# Attributes that name a file, such as fileright of a texture, or a folder of them.
_NAMED_FILE = re.compile(r"""\b(file\w*|meshdir|texturedir|assetdir)\s*=\s*("[^"]*"|'[^']*')""")
_MAX_MODEL_BYTES = 64_000_000
# Half the side of a plane that MuJoCo has without end [m].
_PLANE_M = 50.0


@dataclass(frozen=True, kw_only=True)
class Part:
    """A named part of a file: triangles and what it is called.

    `names` are those it can be addressed by: mesh, node, group, material, solid or geom. `vertices_m` is (n, 3),
    `faces` (m, 3) indices of vertices.
    """

    name: str
    names: frozenset[str]
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    rgba: tuple[float, float, float, float] = PART_RGBA


def load_parts(path: Path, *, scale: float, up: Up | None, translate_m: tuple[float, float, float]) -> list[Part]:
    """Return the parts of a file, in metres, z upwards.

    Args:
        path: The file; its ending says which format it has.
        scale: Metres per unit of the file.
        up: The file's axis that points up; by default that of its format.
        translate_m: Is added last [m].
    """
    ending = path.suffix.lower()
    if ending not in DEFAULT_UP:
        raise EnvironmentDataError(
            f"{path.name}: expected a file of {', '.join(DEFAULT_UP)}, was {ending or 'one without ending'}.\n"
            f"File: {path}"
        )
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise EnvironmentDataError(f"{path.name}: expected a file of geometry, was {found}.\nFile: {path}")
    parts = _read(path, ending)
    _check(parts, path)
    is_y_up = (up or DEFAULT_UP[ending]) == "y"
    return [_placed(part, scale, translate_m, is_y_up=is_y_up) for part in parts]


def _read(path: Path, ending: str) -> list[Part]:
    if ending == ".xml":
        # MuJoCo takes half a second to import, and only rooms from MJCF need it.
        return load_mjcf_parts(path)
    try:
        if ending == ".stl":
            _check_stl(read_regular_file(path))
        with warnings.catch_warnings():
            # What the reader only warns of, such as text that ends within a number, is a damaged file too.
            warnings.simplefilter("error")
            return _read_scene(path, ending)
    except Exception as error:
        # The library raises whatever its parsers run into: each of it means that the file is not what it should be.
        raise EnvironmentDataError(
            f"{path.name}: expected a whole {ending[1:]} file, was {path.stat().st_size} bytes that are not "
            f"({_one_line(error)}). Export it again.\nFile: {path}"
        ) from error


def _read_scene(path: Path, ending: str) -> list[Part]:
    # trimesh takes half a second to import, and only rooms from meshes need it.
    import trimesh

    refused: list[ValueError] = []

    # Materials, textures and buffers; that one of them is refused, the library need not pass on.
    class Resolver(trimesh.resolvers.FilePathResolver):
        def absolute(self, name: str) -> Path:
            named = super().absolute(name)
            try:
                if named.exists():
                    check_regular_file(named)
            except OSError as error:
                refused.append(ValueError(f"{name} is {describe_os_error(error)}"))
                raise refused[-1] from error
            return named

    resolver = Resolver(str(path))
    solids = frozenset[str]()
    if ending == ".obj":
        parts = _read_obj(path, resolver)
        if refused:
            raise refused[0]
        return parts
    scene = trimesh.load_scene(path, process=False, resolver=resolver)
    if ending == ".stl":
        text = read_regular_file(path).decode(errors="replace")
        solids = frozenset(re.findall(r"^\s*solid[ \t]+(\S.*?)\s*$", text, flags=re.MULTILINE | re.IGNORECASE))
    if refused:
        raise refused[0]
    parts: list[Part] = []
    for node in sorted(map(str, scene.graph.nodes_geometry)):
        to_world, geometry_name = scene.graph[node]
        mesh = scene.geometry[str(geometry_name)]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            mesh = mesh.copy()
            mesh.apply_transform(to_world)
            names = {node, str(geometry_name)}
            # Solids of one name are numbered from the second on.
            if ending == ".stl" and node not in solids:
                names |= {re.sub(r"_\d+$", "", node)} & solids
            parts.append(_part_of(mesh, node, names))
    return parts


def _part_of(mesh: Any, node: str, names: set[str]) -> Part:
    material: Any = getattr(mesh.visual, "material", None)
    if isinstance(getattr(material, "name", None), str):
        names.add(material.name)
    color = material.main_color if material is not None else mesh.visual.main_color
    has_color = material is not None or mesh.visual.defined
    return Part(
        name=node,
        names=frozenset(names),
        vertices_m=np.asarray(mesh.vertices, dtype=np.float64),
        faces=np.asarray(mesh.faces, dtype=np.int64),
        rgba=_rgba_of(color) if has_color and len(color) == 4 else PART_RGBA,
    )


def _rgba_of(color: Any) -> tuple[float, float, float, float]:
    red, green, blue, alpha = (round(float(channel) / 255, 6) for channel in color)
    return red, green, blue, alpha


# The library's reader fans concave faces, counts indices below zero from the end of the file, takes no tabs and no
# remarks, and joins names, so that `wall` would be found in `wall_outlet`.
def _read_obj(path: Path, resolver: Any) -> list[Part]:
    from trimesh.exchange.obj import parse_mtl
    from trimesh.visual.material import SimpleMaterial

    text = "\n".join(read_regular_file(path).decode(errors="replace").splitlines())
    vertices: list[tuple[float, float, float]] = []
    colors: list[tuple[int, ...]] = []
    materials: dict[str, Any] = {}
    polygons: dict[tuple[tuple[str, ...], ...], list[list[int]]] = {}
    current: dict[str, tuple[str, ...]] = {"o": (), "g": (), "usemtl": ()}
    for line in re.sub(r"\\\s*\n", " ", text).split("\n"):
        word, *rest = line.split() or [""]
        if word == "v":
            x, y, z, *color = map(float, line.partition("#")[0].split()[1:])
            vertices.append((x, y, z))
            colors.append(tuple(round(255 * channel) for channel in color[:3]))
        elif word == "f":
            corners = [_vertex_of(corner, len(vertices)) for corner in line.partition("#")[0].split()[1:]]
            if len(corners) < 3:
                raise ValueError(f"a face of {len(corners)} corners")
            polygons.setdefault(tuple(current.values()), []).append(corners)
        elif word in current:
            current[word] = tuple(rest)
        elif word == "mtllib":
            # A room needs no colours: a file of materials that is missing or damaged goes without.
            with contextlib.suppress(Exception):
                materials |= parse_mtl(resolver[line.strip()[6:].strip()], resolver=resolver)
    n_materials = len(materials.keys() | {" ".join(key[2]) for key in polygons if key[2]})
    parts: dict[str, Part] = {}
    for key, faces in polygons.items():
        words = [" ".join(each) for each in (key if n_materials > 1 else key[:2]) if each]
        numbered = itertools.chain(("",), (f"_{i}" for i in itertools.count(1)))
        name = next(name for end in numbered if (name := ("_".join(words) or path.name) + end) not in parts)
        if max(map(max, faces)) >= len(vertices):
            raise ValueError(f"a face with index {max(map(max, faces)) + 1}, of {len(vertices)} vertices")
        used, at = np.unique([triangle for face in faces for triangle in _cut(face, vertices)], return_inverse=True)
        # A line of groups names each of them.
        names = {name, *key[1], *(" ".join(each) for each in key if each)}
        material = materials.get(" ".join(key[2]))
        color = (
            SimpleMaterial(**material).main_color
            if material
            else [*Counter(colors[i] for i in used).most_common(1)[0][0], 255]
        )
        parts[name] = Part(
            name=name,
            names=frozenset(names),
            vertices_m=np.array(vertices)[used],
            faces=at.reshape(-1, 3).astype(np.int64),
            rgba=_rgba_of(color) if len(color) == 4 else PART_RGBA,
        )
    return [parts[name] for name in sorted(parts)]


def _vertex_of(corner: str, n: int) -> int:
    index = corner.partition("/")[0]
    number = int(index)
    if number == 0 or number < -n:
        raise ValueError(f"a face with index {index}, behind {n} of its kind")
    return number + n if number < 0 else number - 1


# Triangles of a face, concave or not: a fan where none of its triangles is turned over, else by clipping ears.
def _cut(face: list[int], vertices: list[tuple[float, float, float]]) -> list[tuple[int, int, int]]:
    fan = [(face[0], *pair) for pair in itertools.pairwise(face[1:])]
    if len(fan) == 1:
        return fan

    def double_area(a: int, b: int, c: int, u: int, v: int) -> float:
        p, q, r = vertices[a], vertices[b], vertices[c]
        return (q[u] - p[u]) * (r[v] - p[v]) - (q[v] - p[v]) * (r[u] - p[u])

    planes = ((0, 1), (1, 2), (2, 0))
    area, (u, v) = max(((sum(double_area(*each, *plane) for each in fan), plane) for plane in planes), key=_size)
    u, v = (u, v) if area > 0 else (v, u)
    least = -1e-9 * abs(area)
    if all(double_area(*each, u, v) >= least for each in fan):
        return fan
    triangles: list[tuple[int, int, int]] = []
    rest = list(face)
    while len(rest) > 2:
        for i, b in enumerate(rest):
            a, c = rest[i - 1], rest[(i + 1) % len(rest)]
            sides = ((a, b), (b, c), (c, a))
            # A hole hangs on the rim by an edge there and back, whose corners are there twice.
            others = [p for p in rest if vertices[p] not in (vertices[a], vertices[b], vertices[c])]
            is_free = not any(all(double_area(*side, p, u, v) >= 0 for side in sides) for p in others)
            if is_free and double_area(a, b, c, u, v) > (-least if len(rest) > 3 else least):
                triangles.append((a, b, c))
                del rest[i]
                break
        else:
            raise ValueError(f"a face of {len(face)} corners whose edges cross; divide it into triangles")
    return triangles


def _size(area_and_plane: tuple[float, tuple[int, int]]) -> float:
    return abs(area_and_plane[0])


# The reader takes a binary file of the wrong length for text, and text that ends early for a shorter file.
def _check_stl(content: bytes) -> None:
    n_triangles = struct.unpack("<I", content[80:84])[0] if len(content) >= 84 else 0
    # A binary file may begin with the same word as a text.
    if len(content) >= 84 and len(content) == 84 + 50 * n_triangles:
        return
    if content.lstrip()[:5].lower() == b"solid" and b"facet" in content[:4096].lower():
        n_begun, n_ended = (
            len(re.findall(rb"^\s*" + word, content, flags=re.I | re.M)) for word in (b"facet", b"endfacet")
        )
        if n_begun != n_ended or b"endsolid" not in content[-1024:].lower():
            raise ValueError(f"the text ends after {n_ended} of at least {n_begun} triangles, without endsolid")
        return
    raise ValueError(f"its header says {n_triangles} triangles, which take {84 + 50 * n_triangles} bytes")


def _check(parts: list[Part], path: Path) -> None:
    if not parts:
        raise EnvironmentDataError(f"{path.name}: expected at least one triangle, was empty.\nFile: {path}")
    for part in parts:
        if part.faces.min() < 0 or part.faces.max() >= len(part.vertices_m):
            raise EnvironmentDataError(
                f"{path.name}: {part.name}: expected faces of its {len(part.vertices_m)} vertices, "
                f"was a face with vertex {part.faces.max()}. Export it again.\nFile: {path}"
            )
        bad = np.argwhere(~np.isfinite(part.vertices_m).all(axis=1))
        if len(bad):
            raise EnvironmentDataError(
                f"{path.name}: {part.name}: expected finite vertices, was {len(bad)} that are not, the first number "
                f"{bad[0, 0]}. Remove them in the program that made the file.\nFile: {path}"
            )


def _placed(part: Part, scale: float, translate_m: tuple[float, float, float], *, is_y_up: bool) -> Part:
    vertices_m = part.vertices_m * scale
    if is_y_up:
        vertices_m = np.stack((vertices_m[:, 0], -vertices_m[:, 2], vertices_m[:, 1]), axis=1)
    return replace(part, vertices_m=vertices_m + np.asarray(translate_m))


def _one_line(error: Exception) -> str:
    return (str(error) or type(error).__name__).splitlines()[0][:200]


def load_mjcf_parts(path: Path) -> list[Part]:
    """Return one part for each geom of an MJCF file, in its initial pose, in the file's unit.

    Round shapes become prisms and rings of 32 sides. A part can be addressed by the names of its geom, body, mesh and
    material.
    """
    try:
        _check_named_files(path)
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, OSError) as error:
        is_refused = isinstance(error, OSError)
        found = f"{error.filename}: {describe_os_error(error)}" if is_refused else " ".join(str(error).split())
        raise EnvironmentDataError(
            f"{path.name}: expected MJCF that MuJoCo takes, was {found}\nFile: {path}"
        ) from error
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return [_build_geom_part(model, data, i, path) for i in range(model.ngeom)]


# MuJoCo opens them itself, and would wait for a pipe for ever. It looks for a name in several places, which depend on
# options of all files together: each of them is looked at.
def _check_named_files(model: Path) -> None:
    waiting, seen, folders, names = [model], {model}, {""}, set[str]()
    while waiting:
        content = read_regular_file(waiting.pop(), max_bytes=_MAX_MODEL_BYTES).decode(errors="replace")
        for key, quoted in _NAMED_FILE.findall(content):
            (names if key.startswith("file") else folders).add(html.unescape(quoted[1:-1]))
        for folder, name in itertools.product(folders, names):
            for place in (model.parent / folder / name, model.parent / folder / Path(name).name):
                if name and place not in seen and place.exists() and not place.is_dir():
                    seen.add(place)
                    with open_regular_file(place) as file:
                        if file.read(64).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
                            waiting.append(place)


def _build_geom_part(model: mujoco.MjModel, data: mujoco.MjData, i: int, path: Path) -> Part:
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
