"""Geometry and occupancy of an environment without wind; with wind it becomes an `Environment`."""

import hashlib
import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Box, Environment, Light, Opening, VisualMesh, WindFrames


@dataclass(frozen=True, kw_only=True)
class EnvironmentGeometry:
    """Geometry and occupancy of a room; see `gslcosim.environment.model.Environment`, which adds the wind.

    `notices` are sentences for the user on what was done differently from what the scenario says.
    """

    name: str
    grid: Grid
    occupancy: NDArray[np.uint8]
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    notices: tuple[str, ...] = ()
    lights: tuple[Light, ...] = ()
    meshes: tuple[VisualMesh, ...] = ()


def with_wind(room: EnvironmentGeometry, wind: WindFrames) -> Environment:
    """Return the environment that a room and its wind make; its arrays are read-only and in C order.

    Raises:
        EnvironmentDataError: the wind is not (t, nx, ny, nz, 3) of the room's grid.
    """
    velocity_m_s = freeze_array(np.ascontiguousarray(wind.velocity_m_s, dtype=np.float32))
    if velocity_m_s.shape[1:] != (*room.grid.shape, 3) or not len(velocity_m_s):
        raise EnvironmentDataError(
            f"wind of {room.name}: expected (t, nx, ny, nz, 3) with cells {room.grid.shape} and at least one frame, "
            f"was {velocity_m_s.shape}"
        )
    frozen_wind = WindFrames(velocity_m_s=velocity_m_s, period_s=wind.period_s, is_looping=wind.is_looping)
    return Environment(
        name=room.name,
        grid=room.grid,
        occupancy=room.occupancy,
        wind=frozen_wind,
        boxes=room.boxes,
        openings=room.openings,
        content_hash=content_hash(room, frozen_wind),
        lights=room.lights,
        meshes=room.meshes,
    )


def content_hash(room: EnvironmentGeometry | Environment, wind: WindFrames) -> str:
    """Return 32 hexadecimal digits that change whenever anything of an environment does."""
    facts = {
        "name": room.name,
        "grid": asdict(room.grid),
        "boxes": [asdict(box) for box in room.boxes],
        "openings": [asdict(opening) for opening in room.openings],
        "lights": [asdict(light) for light in room.lights],
        "wind": {"shape": wind.velocity_m_s.shape, "period_s": wind.period_s, "is_looping": wind.is_looping},
    }
    digest = hashlib.blake2b(json.dumps(facts, sort_keys=True).encode(), digest_size=16)
    digest.update(np.ascontiguousarray(room.occupancy, dtype=np.uint8).data)
    digest.update(np.ascontiguousarray(wind.velocity_m_s, dtype="<f4").data)
    for mesh in room.meshes:
        digest.update(json.dumps([mesh.name, mesh.rgba, mesh.vertices_m.shape, mesh.faces.shape]).encode())
        digest.update(np.ascontiguousarray(mesh.vertices_m, dtype="<f4").data)
        digest.update(np.ascontiguousarray(mesh.faces, dtype="<i4").data)
    return digest.hexdigest()


def freeze_array(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array, which nobody can write to from now on."""
    array.setflags(write=False)
    return array
