"""Environment model that every core shares: geometry, occupancy and wind, read-only."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Literal, NamedTuple, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.environment.grid import Grid


class Cell(IntEnum):
    """Content of a cell of the occupancy grid; the numbers are GADEN's."""

    FREE = 0
    SOLID = 1
    OUTLET = 2


@dataclass(frozen=True, kw_only=True)
class Box:
    """A named solid, axis-aligned box, corners in the world frame [m]."""

    name: str
    kind: Literal["wall", "floor", "ceiling", "obstacle"]
    min_m: Vec3
    max_m: Vec3
    rgba: tuple[float, float, float, float] = (0.6, 0.6, 0.62, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class VisualMesh:
    """Triangles to be looked at; what blocks air, sight and vehicles is occupancy and boxes.

    `vertices_m` is (n, 3) float32, world frame [m]; `faces` (m, 3) int32 of vertex indices. Colours have 256 steps.
    """

    name: str
    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    rgba: tuple[float, float, float, float]

    @classmethod
    def of(
        cls, name: str, vertices_m: NDArray[Any], faces: NDArray[Any], rgba: tuple[float, float, float, float]
    ) -> Self:
        """Return a mesh of arrays of any type of number; the vertices that no face has are left out."""
        used, numbers = np.unique(faces, return_inverse=True)
        kept_m = np.ascontiguousarray(np.asarray(vertices_m)[used], dtype=np.float32)
        renumbered = np.ascontiguousarray(numbers.reshape(-1, 3), dtype=np.int32)
        kept_m.setflags(write=False)
        renumbered.setflags(write=False)
        r, g, b, a = (round(round(channel * 255) / 255, 6) for channel in rgba)
        return cls(name=name, vertices_m=kept_m, faces=renumbered, rgba=(r, g, b, a))


@dataclass(frozen=True, kw_only=True)
class Opening:
    """An inlet, an outlet, or a side where the outdoors go on: a flat box on the boundary of the air, world frame [m].

    `velocity_m_s` is the inlet's; zero for the others.
    """

    name: str
    kind: Literal["inlet", "outlet", "open"]
    min_m: Vec3
    max_m: Vec3
    velocity_m_s: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Light:
    """A lamp that shines down, for pictures and cameras; world frame [m]."""

    name: str
    position_m: Vec3


@dataclass(frozen=True, kw_only=True)
class WindFrames:
    """Wind at cell centres of the environment's grid over time.

    `velocity_m_s` is (t, nx, ny, nz, 3) float32, world frame; one frame means steady wind.
    Frame i holds from i * period_s on; after the last frame time loops, unless `is_looping` is false: then it stays.
    """

    velocity_m_s: NDArray[np.float32]
    period_s: float = 1.0
    is_looping: bool = True

    def frame_at(self, time_s: float) -> int:
        """Return the index of the frame that holds at a time [s]."""
        n_frames = self.velocity_m_s.shape[0]
        index = int(time_s / self.period_s + 1e-9)
        return index % n_frames if self.is_looping else min(index, n_frames - 1)


OWN_WIND = -1
"""In place of the number of an event: the wind is that of the scenario."""


Closed = tuple[str, ...]
"""The names of the doors that are closed, sorted."""

AT_START: Closed = ("at start",)
"""In place of names: as at the start of a run. It is no name, which has no blank."""


class VariantValues(TypedDict):
    """Values of an `EnvironmentVariant` in a file."""

    closed: list[str]
    i_wind: int


class EnvironmentVariant(NamedTuple):
    """Variant of an environment: its closed doors, and the place of the event whose inlet makes the wind."""

    closed: Closed = ()
    i_wind: int = OWN_WIND

    @classmethod
    def from_values(cls, values: VariantValues) -> Self:
        """Return the variant that a file holds."""
        return cls(tuple(values["closed"]), values["i_wind"])


@dataclass(frozen=True, kw_only=True)
class Environment:
    """A room with its wind. The grid covers the air exactly; walls lie outside it unless an importer says otherwise.

    `occupancy` is (nx, ny, nz) uint8 of `Cell`; OUTLET marks free cells that touch an outlet.
    `content_hash` identifies everything in here but `later_rooms`: what events of a run make of it, on the same grid,
    by situation. `meshes` are what the boxes were made from, where they were made from anything; `load_environment`
    reads them only on demand.
    """

    name: str
    grid: Grid
    occupancy: NDArray[np.uint8]
    wind: WindFrames
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    content_hash: str
    lights: tuple[Light, ...] = ()
    meshes: tuple[VisualMesh, ...] = ()
    later_rooms: Mapping[EnvironmentVariant, Self] = field(default_factory=dict[EnvironmentVariant, Self])

    def by_doors(self) -> dict[Closed, Self]:
        """Return the room at the start as `AT_START`, and later rooms by their closed doors, whatever their wind.

        Doors that are closed at the start, and only they, may lack a room of their own: it is that at the start.
        """
        rooms: dict[Closed, Self] = {AT_START: self}
        for variant, room in self.later_rooms.items():
            rooms.setdefault(variant.closed, room)
        return rooms
