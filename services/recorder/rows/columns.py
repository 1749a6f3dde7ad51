"""Columns of rows that wait until they are sent: appended every tick, sent for many ticks at once."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from itertools import chain
from operator import attrgetter
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import ConcentrationSlice, FilamentCloud, Quaternion
from gslcosim.scenario import Scenario
from gslcosim_services.recorder.colors import GasScale, Rgb, gas_colors
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.scene import GAS_COLORMAP, image_format, slice_height_m

# A track grows by a strip of this many ticks; the viewer draws as many strips as have passed.
TRACK_STRIP_TICKS = 10
# A snapshot draws at most this many filaments, evenly chosen and the more opaque, so that files stay small.
MAX_FILAMENTS = 3000
# Peak opacity of a newborn filament; chosen so that a plume of some hundred is seen and seen through.
BIRTH_OPACITY = 0.2
WAYPOINT_RADIUS_M = 0.06
MARKER_RADIUS_M = 0.12


Item = TypeVar("Item")


class Rows(ABC, Generic[Item]):
    """Rows of one entity that wait until they are sent, each made of an item."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._items: list[Item] = []

    def add(self, tick: int, item: Item) -> None:
        """Append a row at the end of a tick."""
        self._ticks.append(tick)
        self._items.append(item)

    def extend(self, ticks: Sequence[int], items: Iterable[Item]) -> None:
        """Append rows at the ends of ticks."""
        self._ticks += ticks
        self._items.extend(items)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            file.send(self._entity, self._ticks, self._columns(self._items))
            self._ticks, self._items = [], []

    @abstractmethod
    def _columns(self, items: Sequence[Item]) -> Iterable[rr.ComponentColumn]: ...


def split_columns(
    ticks: Sequence[int], rows: Sequence[Sequence[Any]], *key: str
) -> Iterable[tuple[Any, tuple[Sequence[int], Sequence[Any]]]]:
    """Split rows of items, one row at each tick, into a column of ticks and items for each key.

    Rows with the same keys in the same order, which they nearly always have, are turned as they are: sorting in one
    item after another takes several times as long.

    Args:
        ticks: Of the rows.
        rows: At most one item for a key in each.
        key: Attributes that make up the key of an item; of several their tuple is the key.

    Returns:
        Keys, and the ticks with an item of each key, with those items.
    """
    all_keys = [tuple(map(attrgetter(*key), row)) for row in rows]
    if all_keys and all_keys.count(all_keys[0]) == len(all_keys):
        return [(name, (ticks, column)) for name, column in zip(all_keys[0], zip(*rows, strict=True), strict=True)]
    columns: dict[Any, tuple[list[int], list[Any]]] = {}
    for tick, names, row in zip(ticks, all_keys, rows, strict=True):
        for name, item in zip(names, row, strict=True):
            noted = columns.setdefault(name, ([], []))
            noted[0].append(tick)
            noted[1].append(item)
    return columns.items()


# As `rr.Scalars.columns` describes it.
_SCALARS = next(iter(rr.Scalars.columns(scalars=[0.0]))).component_descriptor()


def scalar_columns(values: Sequence[float], lengths: Sequence[int] | None = None) -> list[rr.ComponentColumn]:
    """Return `rr.Scalars.columns` of numbers, as many to each row as `lengths` say (none: one), in a third of its time.

    That one splits its columns into rows twice.
    """
    return [
        rr.ComponentColumn(_SCALARS, rr.components.ScalarBatch(np.array(values, dtype=np.float64)), lengths=lengths)
    ]


class ScalarRows(Rows[float]):
    """A curve: one number per row."""

    def _columns(self, items: Sequence[float]) -> list[rr.ComponentColumn]:
        return scalar_columns(items)


class CurveRows(Rows[Sequence[float]]):
    """Curves of a sensor: some values of each of its readings, those of `part`."""

    def __init__(self, entity: str, part: slice) -> None:
        super().__init__(entity)
        self._part = part

    def _columns(self, items: Sequence[Sequence[float]]) -> list[rr.ComponentColumn]:
        rows = [values[self._part] for values in items]
        return scalar_columns([*chain.from_iterable(rows)], [*map(len, rows)])


class PoseRows(Rows[tuple[Vec3, Quaternion]]):
    """A moving body: world-from-body transforms, made of position and quaternion wxyz."""

    def _columns(self, items: Sequence[tuple[Vec3, Quaternion]]) -> rr.ComponentColumnList:
        positions_m, quaternions_wxyz = zip(*items, strict=True)
        # Rerun wants (x, y, z, w).
        quaternions_xyzw = np.roll(np.array(quaternions_wxyz, dtype=np.float32), -1, axis=1)
        return rr.Transform3D.columns(translation=np.array(positions_m, np.float32), quaternion=quaternions_xyzw)


class TrackRows(Rows[Sequence[Vec3]]):
    """The line a vehicle leaves behind, in strips of `TRACK_STRIP_TICKS`: the viewer shows all up to its cursor."""

    def __init__(self, entity: str) -> None:
        super().__init__(entity)
        self._open_strip_m: list[Vec3] = []
        self._last_tick = 0

    def add_positions(self, ticks: Sequence[int], positions_world_m: Sequence[Vec3]) -> None:
        """Append the positions at the ends of ticks."""
        begin = 0
        while begin < len(ticks):
            end = min(begin + TRACK_STRIP_TICKS + 1 - len(self._open_strip_m), len(ticks))
            self._open_strip_m += positions_world_m[begin:end]
            self._last_tick = ticks[end - 1]
            if len(self._open_strip_m) > TRACK_STRIP_TICKS:
                self.end_strip()
            begin = end

    def end_strip(self) -> None:
        """End the open strip here; the next one starts where it ends."""
        if len(self._open_strip_m) > 1:
            self.add(self._last_tick, self._open_strip_m)
            self._open_strip_m = self._open_strip_m[-1:]

    # Told a list of strips Rerun makes an array of each; this is the type in which it stores them.
    def _columns(self, items: Sequence[Sequence[Vec3]]) -> rr.ComponentColumnList:
        flat = pa.array(np.array([*chain.from_iterable(items)], dtype=np.float32).ravel())
        ends = pa.array(np.cumsum([0, *map(len, items)], dtype=np.int32))
        points = pa.FixedSizeListArray.from_arrays(flat, type=_POINT_TYPE)
        return rr.LineStrips3D.columns(strips=pa.ListArray.from_arrays(ends, points, type=_STRIP_TYPE))


_POINT_TYPE: Any = pa.list_(pa.field("item", pa.float32(), nullable=False), 3)
_STRIP_TYPE: Any = pa.list_(pa.field("item", _POINT_TYPE, nullable=False))


class PlanRows(Rows[tuple[Vec3, ...]]):
    """Planned paths, each from where the vehicle was when it was planned, through its bends."""

    def __init__(self, entity: str) -> None:
        super().__init__(entity)
        self._path_m: tuple[Vec3, ...] = ()

    def add_paths(
        self, ticks: Sequence[int], positions_world_m: Sequence[Vec3], paths_world_m: Sequence[tuple[Vec3, ...]]
    ) -> None:
        """Append the paths ahead at the ends of ticks, each unless it is the rest of the one before."""
        if self._path_m or any(paths_world_m):
            for tick, position_m, path_m in zip(ticks, positions_world_m, paths_world_m, strict=True):
                if path_m and self._path_m[-len(path_m) :] != path_m:
                    self.add(tick, (position_m, *path_m))
                self._path_m = path_m

    def _columns(self, items: Sequence[tuple[Vec3, ...]]) -> rr.ComponentColumnList:
        return rr.LineStrips3D.columns(strips=[np.array(strip, dtype=np.float32) for strip in items])


class Marker(NamedTuple):
    """A point with a text, which may be empty; `is_shown` says whether it is seen without hovering over the point."""

    position_world_m: Vec3
    label: str
    color: Rgb
    is_shown: bool = True


class MarkerRows(Rows[Marker]):
    """Points that stay once they have come. Several rows may share a tick: the viewer shows every row of its range."""

    def __init__(self, entity: str, *, radius_m: float) -> None:
        super().__init__(entity)
        self._radius_m = radius_m

    def _columns(self, items: Sequence[Marker]) -> rr.ComponentColumnList:
        return rr.Points3D.columns(
            positions=np.array([item.position_world_m for item in items], dtype=np.float32),
            labels=[item.label for item in items],
            colors=np.array([item.color for item in items], dtype=np.uint8),
            radii=np.full(len(items), self._radius_m, dtype=np.float32),
            show_labels=[item.is_shown and bool(item.label) for item in items],
        )


class TextRows(Rows[tuple[str, str]]):
    """Lines of a text log, each with its level."""

    def _columns(self, items: Sequence[tuple[str, str]]) -> rr.ComponentColumnList:
        return rr.TextLog.columns(text=[text for text, _ in items], level=[level for _, level in items])


class FilamentRows(Rows[FilamentCloud]):
    """Filaments as what they are: Gaussian puffs, drawn with their own standard deviation.

    Colour is the mixing ratio at the centre, ppm0 (sigma0 / sigma)^3; peak opacity goes with the amount of gas along
    a line of sight through the centre, (sigma0 / sigma)^2 (our derivation: the integral of a Gaussian puff of constant
    mass along a line falls with sigma^-2). `ppm0` and `sigma0` are those of the first source of the scenario.
    """

    def __init__(self, entity: str, scenario: Scenario) -> None:
        super().__init__(entity)
        source = scenario.gas.sources[0]
        self._birth_sigma_m = source.sigma_m
        self._birth_ppm = source.ppm
        self._scale = GasScale.of(scenario)
        # Packed as 0xRRGGBB00, which Rerun takes with the opacity and without looking at every colour.
        self._colors = gas_colors().astype(np.uint32) @ np.array([1 << 24, 1 << 16, 1 << 8], dtype=np.uint32)

    def _columns(self, items: Sequence[FilamentCloud]) -> rr.ComponentColumnList:
        counts = [cloud.sigma_m.shape[0] for cloud in items]
        strides = [max(1, -(-count // MAX_FILAMENTS)) for count in counts]
        centres_m = np.concatenate([c.position_world_m.to_array()[::s] for c, s in zip(items, strides, strict=True)])
        sigmas_m = np.concatenate([c.sigma_m.to_array()[::s] for c, s in zip(items, strides, strict=True)])
        drawn = [-(-count // stride) for count, stride in zip(counts, strides, strict=True)]
        columns = rr.GaussianSplats3D.columns(
            centers=np.ascontiguousarray(centres_m, dtype=np.float32),
            scales=np.repeat(sigmas_m.astype(np.float32), 3).reshape(-1, 3),
            colors=self._rgba(sigmas_m, np.repeat(strides, drawn)),
        )
        return columns.partition(drawn)

    def _rgba(self, sigmas_m: NDArray[np.float32], strides: NDArray[np.int64]) -> NDArray[np.uint32]:
        shrink = np.float32(self._birth_sigma_m) / np.maximum(sigmas_m, np.float32(self._birth_sigma_m))
        levels = self._scale.levels(self._birth_ppm * shrink**3)
        alpha = np.clip(BIRTH_OPACITY * 255 * strides * shrink**2, 2, 255)
        return self._colors[levels] | alpha.astype(np.uint32)


class SliceRows(Rows[ConcentrationSlice]):
    """A horizontal slice through the gas at its height: the levels of `GasScale`, which the viewer colours."""

    def __init__(self, entity: str, scale: GasScale) -> None:
        super().__init__(entity)
        self._scale = scale
        self._is_placed = False

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and before the first ones where they are."""
        if self._items and not self._is_placed:
            first = self._items[0]
            place = rr.GridMap.from_fields(
                format=image_format(*first.mixing_ratio_ppm.shape),
                colormap=GAS_COLORMAP,
                cell_size=first.cell_m,
                translation=(*first.origin_m, slice_height_m(first.height_m)),
            )
            file.draw(self._entity, place)
            self._is_placed = True
        super().send(file)

    # Rows of a picture run from the far side (largest y) to the near one.
    def _columns(self, items: Sequence[ConcentrationSlice]) -> rr.ComponentColumnList:
        levels = [self._scale.levels(item.mixing_ratio_ppm.to_array()).T[::-1].ravel() for item in items]
        return rr.GridMap.columns(data=np.stack(levels))
