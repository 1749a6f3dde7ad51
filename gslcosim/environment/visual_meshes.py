"""Meshes to be looked at, as a binary glTF file: what the environment folder holds of them.

Each mesh is a node of its name with one primitive: positions in single precision, indices, and a material with the base
colour. glTF's y points up, so x, y, z are stored as x, z, -y; nothing else is done to the numbers, so reading returns
what was written.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.environment.model import VisualMesh
from gslcosim.errors import EnvironmentDataError


def glb_of(meshes: Sequence[VisualMesh]) -> bytes:
    """Return meshes as a binary glTF file."""
    # trimesh takes half a second to import, and only rooms with meshes need it.
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    scene = trimesh.Scene()
    for mesh in meshes:
        x, y, z = mesh.vertices_m.T
        color = [round(channel * 255) for channel in mesh.rgba]
        material = PBRMaterial(
            name=mesh.name, baseColorFactor=color, alphaMode="BLEND" if mesh.rgba[3] < 1 else "OPAQUE", doubleSided=True
        )
        part = trimesh.Trimesh(
            vertices=np.stack((x, z, -y), axis=1),
            faces=mesh.faces,
            process=False,
            visual=TextureVisuals(material=material),
        )
        scene.add_geometry(part, node_name=mesh.name, geom_name=mesh.name)
    content = scene.export(file_type="glb")
    assert isinstance(content, bytes), "glb is bytes"
    return content


def load_visual_meshes(path: Path, names: Sequence[str]) -> tuple[VisualMesh, ...]:
    """Return the meshes of a file of `glb_of`, in the order of their names.

    Raises:
        EnvironmentDataError: the file is missing or damaged, or holds other meshes.
    """
    import trimesh

    try:
        scene = trimesh.load_scene(io.BytesIO(path.read_bytes()), file_type="glb", process=False)
        return tuple(_mesh_of(name, scene.geometry[name]) for name in names)
    except FileNotFoundError as error:
        raise EnvironmentDataError(f"{path.name}: expected meshes, was missing.\nFile: {path}") from error
    except Exception as error:
        # The library raises whatever its parser runs into: each of it means that the file is damaged.
        raise EnvironmentDataError(
            f"{path.name}: expected whole glTF with {len(names)} meshes, was {path.stat().st_size} bytes that are not "
            f"({type(error).__name__}: {error}). Make the environment again.\nFile: {path}"
        ) from error


def _mesh_of(name: str, part: Any) -> VisualMesh:
    x, up, south = np.asarray(part.vertices).T
    r, g, b, a = (float(channel) / 255 for channel in part.visual.material.main_color)
    return VisualMesh.of(name, np.stack((x, -south, up), axis=1), np.asarray(part.faces), (r, g, b, a))
