"""Meshes of a room as binary glTF: the file `visual.glb` of an environment folder.

Each mesh is a node of its name with one primitive: positions in single precision, indices, and a material with the base
colour. glTF's y points up, so x, y, z are stored as x, z, -y; this keeps all digits, so that reading returns the
written numbers.
"""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.files import read_regular_file
from gslcosim.environment.model import VisualMesh

_MAGIC, _JSON, _BIN = b"glTF", b"JSON", b"BIN\0"
_HEAD, _CHUNK = struct.Struct("<4sII"), struct.Struct("<I4s")
_FLOAT, _UINT = 5126, 5125
_TYPES = {_FLOAT: "<f4", _UINT: "<u4", 5123: "<u2", 5121: "u1"}
_TRIANGLES = 4


def encode_glb(meshes: Sequence[VisualMesh]) -> bytes:
    """Return meshes as a binary glTF file."""
    views: list[dict[str, int]] = []
    accessors: list[dict[str, Any]] = []
    content = bytearray()

    def add_array(array: NDArray[Any], **more: Any) -> int:
        views.append({"buffer": 0, "byteOffset": len(content), "byteLength": array.nbytes})
        accessors.append({"bufferView": len(accessors), "count": len(array), **more})
        content.extend(array.tobytes())
        return len(accessors) - 1

    primitives: list[dict[str, Any]] = []
    for i, mesh in enumerate(meshes):
        x, y, z = mesh.vertices_m.T
        places = np.stack((x, z, -y), axis=1).astype("<f4")
        bounds = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
        position = add_array(places, componentType=_FLOAT, type="VEC3", **bounds)
        indices = add_array(mesh.faces.astype("<u4").reshape(-1), componentType=_UINT, type="SCALAR")
        primitives.append({"attributes": {"POSITION": position}, "indices": indices, "material": i, "mode": _TRIANGLES})
    scene = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(meshes)))}],
        "nodes": [{"name": mesh.name, "mesh": i} for i, mesh in enumerate(meshes)],
        "meshes": [{"name": mesh.name, "primitives": [own]} for mesh, own in zip(meshes, primitives, strict=True)],
        "materials": [_material_of(mesh) for mesh in meshes],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(content)}],
    }
    text = json.dumps(scene, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    n_bytes = _HEAD.size + 2 * _CHUNK.size + len(text) + len(content)
    return b"".join(
        (_HEAD.pack(_MAGIC, 2, n_bytes), _CHUNK.pack(len(text), _JSON), text, _CHUNK.pack(len(content), _BIN), content)
    )


def load_visual_meshes(path: Path, names: Sequence[str]) -> tuple[VisualMesh, ...]:
    """Return the meshes of a file of `encode_glb`, in the order of their names."""
    try:
        scene, content = _split(read_regular_file(path))
        meshes = {mesh["name"]: mesh["primitives"][0] for mesh in scene["meshes"]}
        return tuple(_mesh_of(name, meshes[name], scene, content) for name in names)
    except FileNotFoundError as error:
        raise EnvironmentDataError(f"{path.name}: expected meshes, was missing.\nFile: {path}") from error
    except (ValueError, LookupError, TypeError, AttributeError, struct.error, RecursionError) as error:
        raise EnvironmentDataError(
            f"{path.name}: expected whole glTF with {len(names)} meshes, was {path.stat().st_size} bytes that are not "
            f"({type(error).__name__}: {error}). Make the environment again.\nFile: {path}"
        ) from error


def _material_of(mesh: VisualMesh) -> dict[str, Any]:
    return {
        "name": mesh.name,
        "pbrMetallicRoughness": {"baseColorFactor": [round(channel * 255) / 255 for channel in mesh.rgba]},
        "alphaMode": "BLEND" if mesh.rgba[3] < 1 else "OPAQUE",
        "doubleSided": True,
    }


def _split(data: bytes) -> tuple[dict[str, Any], memoryview]:
    magic, version, n_bytes = _HEAD.unpack_from(data)
    if (magic, version, n_bytes) != (_MAGIC, 2, len(data)):
        raise ValueError(f"expected {n_bytes} bytes of glTF 2")
    n_text, _ = _CHUNK.unpack_from(data, _HEAD.size)
    start = _HEAD.size + _CHUNK.size
    return json.loads(data[start : start + n_text]), memoryview(data)[start + n_text + _CHUNK.size :]


def _mesh_of(name: str, primitive: dict[str, Any], scene: dict[str, Any], content: memoryview) -> VisualMesh:
    x, up, south = _read_array(primitive["attributes"]["POSITION"], scene, content, 3).T
    faces = _read_array(primitive["indices"], scene, content, 1).reshape(-1, 3)
    color = scene["materials"][primitive["material"]]["pbrMetallicRoughness"]["baseColorFactor"]
    r, g, b, a = (round(channel * 255) / 255 for channel in color)
    vertices_m = np.stack((x, -south, up), axis=1)
    if not np.isfinite(vertices_m).all() or (faces.size and faces.max() >= len(vertices_m)):
        raise ValueError(f"expected finite corners, and faces of them, in {name!r}")
    return VisualMesh.of(name, vertices_m, faces, (r, g, b, a))


def _read_array(i: int, scene: dict[str, Any], content: memoryview, n_components: int) -> NDArray[Any]:
    accessor = scene["accessors"][i]
    view = scene["bufferViews"][accessor["bufferView"]]
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    n_values = accessor["count"] * n_components
    values = np.frombuffer(content, _TYPES[accessor["componentType"]], n_values, start)
    return values.reshape(-1, n_components)
