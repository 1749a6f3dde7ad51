"""Environment model of all cores: grid, geometry, occupancy and wind, read-only."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from enum import IntEnum
from typing import Annotated, Any, Literal, NamedTuple, Self, TypedDict

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.problems import Problem
from gslcosim.base.quantities import Vec3
from gslcosim.scenario.problems import ProblemsError

OWN_WIND = -1
"""In place of the index of an event: the wind is that of the scenario."""

Closed = tuple[str, ...]
"""The names of the doors that are closed, sorted."""

AT_START: Closed = ("at start",)
"""In place of names: the doors at the start of a run. No door has this name, for names have no blanks."""

LAYOUT_PATH = "environment.layout"
# More cells would not fit into the memory of a common machine together with the solver's fields.
MAX_CELLS = 200_000_000

WALL_NAMES = ("wall_x_min", "wall_x_max", "wall_y_min", "wall_y_max", "floor", "ceiling")
FLOOR_RGBA = (0.45, 0.45, 0.47, 1.0)
CEILING_RGBA = (0.8, 0.8, 0.82, 0.15)
OBSTACLE_RGBA = (0.62, 0.46, 0.30, 1.0)


class ImpossibleEnvironmentError(ProblemsError):
    """A room cannot be built; the text lists all `problems`, one a line. The scenario or its files have to change."""


def raise_if_any(problems: Sequence[Problem]) -> None:
    """Raise all problems as one error; do nothing when there are none.

    Raises:
        ImpossibleEnvironmentError: there is at least one problem.
    """
    if problems:
        raise ImpossibleEnvironmentError(problems)


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A box of equal cubic cells; index order is (x, y, z), cell (0, 0, 0) touches `origin_m`."""

    origin_m: Vec3
    cell_m: Annotated[float, Field(gt=0)]
    shape: tuple[int, int, int]

    @property
    def max_m(self) -> Vec3:
        """The corner opposite to `origin_m`, world frame [m]."""
        o, n = self.origin_m, self.shape
        return (o[0] + n[0] * self.cell_m, o[1] + n[1] * self.cell_m, o[2] + n[2] * self.cell_m)

    def cell_of(self, position_world_m: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the (…, 3) indices of the cells that hold (…, 3) points; they may lie outside the grid."""
        return np.floor((np.asarray(position_world_m) - self.origin_m) / self.cell_m).astype(np.int64)

    def index_at(self, axis: int, coordinate_m: float) -> int:
        """Return the index of the layer across an axis that holds a coordinate [m]; outside the grid the nearest."""
        index = int((coordinate_m - self.origin_m[axis]) / self.cell_m)
        return min(max(index, 0), self.shape[axis] - 1)

    def contains_cell(self, cell: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of (…, 3) cell indices lie in the grid."""
        return np.all((cell >= 0) & (cell < self.shape), axis=-1)

    def contains_points(self, points_world_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of (n, 3) points, world frame [m], are in the box or on its border."""
        # The slack keeps points on the border inside, although single precision rounds a grid's corners.
        slack_m = 1e-6 * self.cell_m
        low_m, high_m = np.subtract(self.origin_m, slack_m), np.add(self.max_m, slack_m)
        return np.all((points_world_m >= low_m) & (points_world_m <= high_m), axis=1)

    def find_point_outside(self, points_world_m: NDArray[np.float64]) -> int | None:
        """Return the index of the first of (n, 3) points that is outside the box; None where all are inside."""
        is_inside = self.contains_points(points_world_m)
        return None if is_inside.all() else int(np.argmin(is_inside))

    def centres_m(self) -> NDArray[np.float64]:
        """Return the (nx, ny, nz, 3) cell centres, world frame [m]."""
        return np.stack(np.meshgrid(*(self.axis_centres_m(axis) for axis in range(3)), indexing="ij"), axis=-1)

    def centres_of(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the centres of (…, 3) cell indices, world frame [m]."""
        return np.asarray(self.origin_m, dtype=np.float64) + (cells + 0.5) * self.cell_m

    def axis_centres_m(self, axis: int) -> NDArray[np.float64]:
        """Return the (n,) coordinates of the cell centres on one axis (0, 1, 2 is x, y, z), world frame [m]."""
        return self.origin_m[axis] + (np.arange(self.shape[axis], dtype=np.float64) + 0.5) * self.cell_m


def point_text(point_m: Sequence[float]) -> str:
    """Return a point in the notation of scenario files, such as `[5, 1, 2]`."""
    return "[" + ", ".join(f"{coordinate_m:.6g}" for coordinate_m in point_m) + "]"


def span_text(min_m: Sequence[float], max_m: Sequence[float]) -> str:
    """Return the corners of a box as text, such as `[0, 0, 0] to [5, 1, 2] m`."""
    return f"{point_text(min_m)} to {point_text(max_m)} m"


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
    """Triangles for pictures only: occupancy and boxes block air, sight and vehicles.

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
        """Return a mesh from arrays of any numeric type, without the vertices that no face uses."""
        used, numbers = np.unique(faces, return_inverse=True)
        kept_m = freeze_array(np.ascontiguousarray(np.asarray(vertices_m)[used], dtype=np.float32))
        renumbered = freeze_array(np.ascontiguousarray(numbers.reshape(-1, 3), dtype=np.int32))
        r, g, b, a = (round(round(channel * 255) / 255, 6) for channel in rgba)
        return cls(name=name, vertices_m=kept_m, faces=renumbered, rgba=(r, g, b, a))


@dataclass(frozen=True, kw_only=True)
class Opening:
    """An inlet, an outlet or an open side of the outdoors: a flat box on the boundary of the air, world frame [m].

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
    Frame i holds from i * period_s on; after the last one the frames repeat, or the last one stays where `is_looping`
    is false. `k_epsilon` is (nx, ny, nz, 2) float32, turbulence energy [m2/s2] and its dissipation [m2/s3], if known.
    """

    velocity_m_s: NDArray[np.float32]
    period_s: float = 1.0
    is_looping: bool = True
    k_epsilon: NDArray[np.float32] | None = None

    def frame_at(self, time_s: float) -> int:
        """Return the index of the frame that holds at a time [s]."""
        n_frames = self.velocity_m_s.shape[0]
        index = int(time_s / self.period_s + 1e-9)
        return index % n_frames if self.is_looping else min(index, n_frames - 1)


class VariantValues(TypedDict):
    """Values of an `EnvironmentVariant` in a file."""

    closed: list[str]
    i_wind: int


class EnvironmentVariant(NamedTuple):
    """Variant of an environment: its closed doors, and the index of the event that sets the inlet's wind."""

    closed: Closed = ()
    i_wind: int = OWN_WIND

    @classmethod
    def from_values(cls, values: VariantValues) -> Self:
        """Return the variant of values in a file."""
        return cls(tuple(values["closed"]), values["i_wind"])


@dataclass(frozen=True, kw_only=True)
class EnvironmentGeometry:
    """A room without its wind. The grid covers the air exactly; walls lie outside it, except in imported rooms.

    `occupancy` is (nx, ny, nz) uint8 of `Cell`; OUTLET marks free cells that touch an outlet. Openings of layouts are
    whole cells; walls are closed behind them, so that no vehicle leaves the room. `meshes` are the origin of the boxes
    of an imported geometry; `load_environment` reads them only on demand.
    `notices` are sentences for the user about deviations from the scenario.
    """

    name: str
    grid: Grid
    occupancy: NDArray[np.uint8]
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    notices: tuple[str, ...] = ()
    lights: tuple[Light, ...] = ()
    meshes: tuple[VisualMesh, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Environment(EnvironmentGeometry):
    """A room with its wind.

    `content_hash` identifies everything in it except `notices` and `later_rooms`, its variants during a run, which are
    on the same grid.
    """

    wind: WindFrames
    content_hash: str
    later_rooms: Mapping[EnvironmentVariant, Self] = field(default_factory=dict[EnvironmentVariant, Self])

    def by_doors(self) -> dict[Closed, Self]:
        """Return the room at the start as `AT_START`, and one room of any wind for each later set of closed doors.

        The set of doors that are closed at the start may be missing: its room is `AT_START`.
        """
        rooms: dict[Closed, Self] = {AT_START: self}
        for variant, room in self.later_rooms.items():
            rooms.setdefault(variant.closed, room)
        return rooms


def with_wind(room: EnvironmentGeometry, wind: WindFrames) -> Environment:
    """Return the environment of a room and its wind; its arrays are read-only and in C order.

    Raises:
        EnvironmentDataError: the wind is not (t, nx, ny, nz, 3) of the room's grid, or its k and epsilon do not fit.
    """
    velocity_m_s = freeze_array(np.ascontiguousarray(wind.velocity_m_s, dtype=np.float32))
    if velocity_m_s.shape[1:] != (*room.grid.shape, 3) or not len(velocity_m_s):
        raise EnvironmentDataError(
            f"wind of {room.name}: expected (t, nx, ny, nz, 3) with cells {room.grid.shape} and at least one frame, "
            f"was {velocity_m_s.shape}"
        )
    k_epsilon = None
    if wind.k_epsilon is not None:
        k_epsilon = freeze_array(np.ascontiguousarray(wind.k_epsilon, dtype=np.float32))
        if k_epsilon.shape != (*room.grid.shape, 2):
            raise EnvironmentDataError(
                f"k and epsilon of {room.name}: expected (nx, ny, nz, 2) with cells {room.grid.shape}, "
                f"was {k_epsilon.shape}"
            )
    frozen_wind = replace(wind, velocity_m_s=velocity_m_s, k_epsilon=k_epsilon)
    geometry = {each.name: getattr(room, each.name) for each in fields(EnvironmentGeometry)}
    return Environment(**geometry, wind=frozen_wind, content_hash=content_hash(room, frozen_wind))


def content_hash(room: EnvironmentGeometry, wind: WindFrames) -> str:
    """Return 32 hexadecimal digits that identify the content of an environment."""
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
    if wind.k_epsilon is not None:
        digest.update(b"k_epsilon")
        digest.update(np.ascontiguousarray(wind.k_epsilon, dtype="<f4").data)
    for mesh in room.meshes:
        digest.update(json.dumps([mesh.name, mesh.rgba, mesh.vertices_m.shape, mesh.faces.shape]).encode())
        digest.update(np.ascontiguousarray(mesh.vertices_m, dtype="<f4").data)
        digest.update(np.ascontiguousarray(mesh.faces, dtype="<i4").data)
    return digest.hexdigest()


def freeze_array(array: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only and return it."""
    array.setflags(write=False)
    return array


def closing_boxes(min_m: Vec3, max_m: Vec3, wall_m: float) -> tuple[Box, ...]:
    """Return the six boxes named `WALL_NAMES` that close a box of air from outside, without overlap.

    Args:
        min_m: Lower corner of the air, world frame [m].
        max_m: Upper corner of the air, world frame [m].
        wall_m: Their thickness [m].
    """
    (x0, y0, z0), (x1, y1, z1), w = min_m, max_m, wall_m
    low, high = (x0 - w, y0 - w), (x1 + w, y1 + w)
    return (
        Box(name="wall_x_min", kind="wall", min_m=(*low, z0), max_m=(x0, high[1], z1)),
        Box(name="wall_x_max", kind="wall", min_m=(x1, low[1], z0), max_m=(*high, z1)),
        Box(name="wall_y_min", kind="wall", min_m=(x0, low[1], z0), max_m=(x1, y0, z1)),
        Box(name="wall_y_max", kind="wall", min_m=(x0, y1, z0), max_m=(x1, high[1], z1)),
        Box(name="floor", kind="floor", min_m=(*low, z0 - w), max_m=(*high, z0), rgba=FLOOR_RGBA),
        Box(name="ceiling", kind="ceiling", min_m=(*low, z1), max_m=(*high, z1 + w), rgba=CEILING_RGBA),
    )
