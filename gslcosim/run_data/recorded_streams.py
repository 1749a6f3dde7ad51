"""Streams of a run as arrays; names carry units, frames are the world's, times are simulated."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gslcosim.contract.messages import Belief

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedTrack:
    """Where a vehicle was at the end of each tick.

    Attributes:
        tick: (n,) ascending.
        time_s: (n,) [s].
        position_world_m: (n, 3) [m].
        quaternion_wxyz: (n, 4) world from body, unit length.
    """

    agent: str
    tick: Ints
    time_s: Floats
    position_world_m: Floats
    quaternion_wxyz: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSeries:
    """Numbers over time: what a sensor is exposed to or reports, or a figure of the referee.

    Attributes:
        agent: Whose; empty where it is nobody's.
        sensor: Of which sensor; empty where of none.
        quantity: What it is, for example `mixing_ratio`.
        unit: As messages have it, for example `ppm`; empty for pure numbers.
        gas: Which gas, of true mixing ratios; else empty.
        columns: k names with their units, for example `mixing_ratio_ppm`.
        tick: (n,) ascending.
        time_s: (n,) [s].
        values: (n, k).
    """

    agent: str
    sensor: str
    quantity: str
    unit: str
    columns: tuple[str, ...]
    tick: Ints
    time_s: Floats
    values: Floats
    gas: str = ""

    @property
    def value(self) -> Floats:
        """The (n,) values of its first column."""
        return self.values[:, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedPoints:
    """Places where something happened or somebody was sent; several may share a tick.

    Attributes:
        tick: (n,) ascending.
        time_s: (n,) [s].
        position_world_m: (n, 3) [m].
        label: n texts, some of them empty.
    """

    tick: Ints
    time_s: Floats
    position_world_m: Floats
    label: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedTexts:
    """Lines of a log: n ticks (ascending), times [s], texts, and levels (`INFO`, `WARN`)."""

    tick: Ints
    time_s: Floats
    text: tuple[str, ...]
    level: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedDoor:
    """A door over time: n ticks (ascending) from which on it is closed or open, and times [s]."""

    tick: Ints
    time_s: Floats
    is_closed: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSlices:
    """The gas in one horizontal layer over time.

    Recorded as pictures of 256 levels: a mixing ratio is right within 1.4 % (4 % just above `min_ppm`), and 0 below.

    Attributes:
        gas: Its name.
        tick: (n,) ascending.
        time_s: (n,) [s].
        origin_m: Corner (x, y) that the first cell touches [m].
        cell_m: Side of a cell [m].
        shape: Cells along x and y.
        height_m: Of the layer [m].
        min_ppm: Below this a mixing ratio is 0 [ppm].
        max_ppm: Above this a mixing ratio is this [ppm].
    """

    gas: str
    tick: Ints
    time_s: Floats
    origin_m: tuple[float, float]
    cell_m: float
    shape: tuple[int, int]
    height_m: float
    min_ppm: float
    max_ppm: float
    decode: Callable[[int], NDArray[np.float32]] = field(repr=False)

    def mixing_ratio_ppm(self, i: int) -> NDArray[np.float32]:
        """Return the (nx, ny) mixing ratios [ppm] of the i-th snapshot."""
        return self.decode(i)

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the (nx, ny) mixing ratios [ppm] of the last snapshot not after a time [s], else of the first."""
        return self.decode(max(int(np.searchsorted(self.time_s, time_s + 1e-9, side="right")) - 1, 0))


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedFilaments:
    """The cloud over time; of snapshot i are the filaments `starts[i]:starts[i + 1]`.

    Of clouds with more than 3000 filaments every k-th was recorded.

    Attributes:
        tick: (n,) ascending.
        time_s: (n,) [s].
        starts: (n + 1,).
        centre_world_m: (m, 3) [m].
        sigma_m: (m,) standard deviations [m].
    """

    tick: Ints
    time_s: Floats
    starts: Ints
    centre_world_m: Floats
    sigma_m: Floats

    def snapshot(self, i: int) -> tuple[Floats, Floats]:
        """Return centres (k, 3) and standard deviations (k,) of the i-th snapshot [m]."""
        some = slice(int(self.starts[i]), int(self.starts[i + 1]))
        return self.centre_world_m[some], self.sigma_m[some]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedBeliefs:
    """Where an agent believed the source to be, whenever it published a belief; exactly as published.

    Attributes:
        tick: (n,) ascending.
        time_s: (n,) [s].
        belief: n beliefs; see `gslcosim.contract.messages.Belief`.
    """

    tick: Ints
    time_s: Floats
    belief: tuple[Belief, ...]

    def in_plane(self, i: int) -> Floats:
        """Return the (nx, ny) probabilities of the i-th belief, summed over the height where it is in space."""
        p = self.belief[i].probability.to_array().astype(np.float64)
        return p.sum(axis=2) if p.ndim == 3 else p


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedShapes:
    """What a sensor saw in the world at some ticks: points of a lidar, or rays from the sensor to what they met.

    Attributes:
        tick: (n,) ascending, when the reading came.
        time_s: (n,) [s].
        starts: (n + 1,): of reading i are `points_world_m[starts[i]:starts[i + 1]]`.
        points_world_m: (m, 3) points, or (m, 2, 3) rays; a ray that met nothing has no length [m].
    """

    agent: str
    sensor: str
    tick: Ints
    time_s: Floats
    starts: Ints
    points_world_m: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedPictures:
    """Pictures of a camera as they travelled.

    Attributes:
        tick: (n,) ascending, when the picture came.
        time_s: (n,) [s].
        media_type: Of all of them, for example `image/png`.
        is_depth: Whether pixels are depths of a 16-bit picture [mm].
        data: n encoded pictures.
        position_world_m: (n, 3) of the eye [m].
        quaternion_wxyz: (n, 4) world from camera: x to the right, y down, z ahead.
        size_px: Width and height.
        focal_px: Along x and y.
        centre_px: Principal point.
    """

    agent: str
    sensor: str
    tick: Ints
    time_s: Floats
    media_type: str
    is_depth: bool
    data: tuple[bytes, ...]
    position_world_m: Floats
    quaternion_wxyz: Floats
    size_px: tuple[int, int]
    focal_px: tuple[float, float]
    centre_px: tuple[float, float]


def column_name(words: str, unit: str) -> str:
    """Return the name of a column: words with the unit behind, as names in code have it."""
    suffix = unit.lower().replace("^", "").replace("/", "_").replace(" ", "_")
    name = words.replace(" ", "_")
    return name if suffix in ("", "1") else f"{name}_{suffix}"
