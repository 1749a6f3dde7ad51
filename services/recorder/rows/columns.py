"""Columns of rows that wait until they are sent: appended every tick, sent for many ticks at once."""

from array import array
from collections.abc import Iterable, Sequence
from itertools import chain
from operator import attrgetter
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import ConcentrationSlice, FilamentCloud, Quaternion, Reading
from gslcosim.scenario import Scenario
from gslcosim_services.recorder.colors import GasScale, Rgb, gas_colors
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.scene import GAS_COLORMAP, level_format, slice_height_m

# A track grows by a strip of this many ticks; the viewer draws as many strips as have passed.
TRACK_STRIP_TICKS = 10
# A snapshot draws at most this many filaments, evenly chosen and the more opaque, so that files stay small.
MAX_FILAMENTS = 3000
# Peak opacity of a newborn filament; chosen so that a plume of some hundred is seen and seen through.
BIRTH_OPACITY = 0.2
WAYPOINT_RADIUS_M = 0.06
MARKER_RADIUS_M = 0.12


class Rows(Protocol):
    """Rows of one entity."""

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        ...


class ReadingRows(Rows, Protocol):
    """Rows of one entity that are made of a sensor's readings."""

    def extend(self, ticks: Sequence[int], readings: Sequence[Reading]) -> None:
        """Append what the entity shows of readings that mean something, at the ends of their ticks."""
        ...


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


def scalar_columns(values: "array[float]", lengths: Sequence[int] | None = None) -> list[rr.ComponentColumn]:
    """Return `rr.Scalars.columns` of numbers, as many to each row as `lengths` say (none: one), in a third of its time.

    That one splits its columns into rows twice.
    """
    return [
        rr.ComponentColumn(_SCALARS, rr.components.ScalarBatch(np.array(values, dtype=np.float64)), lengths=lengths)
    ]


class ScalarRows:
    """A curve: one number per row."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._values = array("d")

    def add(self, tick: int, value: float) -> None:
        """Append the value at the end of a tick."""
        self._ticks.append(tick)
        self._values.append(value)

    def extend(self, ticks: Sequence[int], values: Iterable[float]) -> None:
        """Append the values at the ends of ticks."""
        self._ticks += ticks
        self._values.extend(values)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            file.send(self._entity, self._ticks, scalar_columns(self._values))
            self._ticks, self._values = [], array("d")


class CurveRows:
    """Curves of a sensor: some numbers of each of its readings, those of `part`."""

    def __init__(self, entity: str, part: slice) -> None:
        self._entity = entity
        self._part = part
        self._ticks: list[int] = []
        self._values = array("d")
        self._lengths: list[int] = []

    def extend(self, ticks: Sequence[int], readings: Sequence[Reading]) -> None:
        """Append what is drawn of readings that mean something, at the ends of their ticks."""
        rows = [reading.values[self._part] for reading in readings]
        self._ticks += ticks
        self._values.extend(chain.from_iterable(rows))
        self._lengths += map(len, rows)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            file.send(self._entity, self._ticks, scalar_columns(self._values, self._lengths))
            self._ticks, self._values, self._lengths = [], array("d"), []


class PoseRows:
    """A moving body: world-from-body transforms."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._positions_m = array("f")
        self._quaternions_wxyz = array("f")

    def extend(
        self, ticks: Sequence[int], positions_world_m: Iterable[Vec3], quaternions_wxyz: Iterable[Quaternion]
    ) -> None:
        """Append the poses at the ends of ticks."""
        self._ticks += ticks
        self._positions_m.extend(chain.from_iterable(positions_world_m))
        self._quaternions_wxyz.extend(chain.from_iterable(quaternions_wxyz))

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if not self._ticks:
            return
        # Rerun wants (x, y, z, w).
        quaternions_xyzw = np.roll(np.array(self._quaternions_wxyz, dtype=np.float32).reshape(-1, 4), -1, axis=1)
        translations_m = np.array(self._positions_m, dtype=np.float32).reshape(-1, 3)
        file.send(
            self._entity,
            self._ticks,
            rr.Transform3D.columns(translation=translations_m, quaternion=quaternions_xyzw),
        )
        self._ticks, self._positions_m, self._quaternions_wxyz = [], array("f"), array("f")


class TrackRows:
    """The line a vehicle leaves behind, in strips of `TRACK_STRIP_TICKS`: the viewer shows all up to its cursor."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._n_points: list[int] = []
        self._points_m = array("f")
        self._open_strip_m: list[Vec3] = []
        self._last_tick = 0

    def extend(self, ticks: Sequence[int], positions_world_m: Sequence[Vec3]) -> None:
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
            self._ticks.append(self._last_tick)
            self._n_points.append(len(self._open_strip_m))
            self._points_m.extend(chain.from_iterable(self._open_strip_m))
            self._open_strip_m = self._open_strip_m[-1:]

    def send(self, file: RecordingFile) -> None:
        """Write the finished strips, if any, and forget them."""
        if self._ticks:
            strips = _strip_array(self._points_m, self._n_points)
            file.send(self._entity, self._ticks, rr.LineStrips3D.columns(strips=strips))
            self._ticks, self._n_points, self._points_m = [], [], array("f")


# Told a list of strips Rerun makes an array of each; this is the type in which it stores them.
_POINT_TYPE: Any = pa.list_(pa.field("item", pa.float32(), nullable=False), 3)
_STRIP_TYPE: Any = pa.list_(pa.field("item", _POINT_TYPE, nullable=False))


def _strip_array(points_m: "array[float]", n_points: Sequence[int]) -> Any:
    flat = pa.array(np.array(points_m, dtype=np.float32))
    ends = pa.array(np.cumsum([0, *n_points], dtype=np.int32))
    points = pa.FixedSizeListArray.from_arrays(flat, type=_POINT_TYPE)
    return pa.ListArray.from_arrays(ends, points, type=_STRIP_TYPE)


class PlanRows:
    """Planned paths, each from where the vehicle was when it was planned, through its bends."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._strips_m: list[tuple[Vec3, ...]] = []
        self._path_m: tuple[Vec3, ...] = ()

    def extend(
        self, ticks: Sequence[int], positions_world_m: Sequence[Vec3], paths_world_m: Sequence[tuple[Vec3, ...]]
    ) -> None:
        """Append the paths ahead at the ends of ticks, each unless it is the rest of the one before."""
        if self._path_m or any(paths_world_m):
            for tick, position_m, path_m in zip(ticks, positions_world_m, paths_world_m, strict=True):
                self.add(tick, position_m, path_m)

    def add(self, tick: int, position_world_m: Vec3, path_world_m: tuple[Vec3, ...]) -> None:
        """Append the path ahead at the end of a tick, unless it is the rest of the one before."""
        if path_world_m and self._path_m[-len(path_world_m) :] != path_world_m:
            self._ticks.append(tick)
            self._strips_m.append((position_world_m, *path_world_m))
        self._path_m = path_world_m

    def send(self, file: RecordingFile) -> None:
        """Write the waiting paths, if any, and forget them."""
        if self._ticks:
            strips = [np.array(strip, dtype=np.float32) for strip in self._strips_m]
            file.send(self._entity, self._ticks, rr.LineStrips3D.columns(strips=strips))
            self._ticks, self._strips_m = [], []


class MarkerRows:
    """Points that stay once they have come, each with a text, which may be empty, or be shown only on hovering."""

    def __init__(self, entity: str, *, radius_m: float) -> None:
        self._entity = entity
        self._radius_m = radius_m
        self._ticks: list[int] = []
        self._positions_m: list[Vec3] = []
        self._labels: list[str] = []
        self._are_shown: list[bool] = []
        self._colors: list[Rgb] = []

    def add(self, tick: int, position_world_m: Vec3, label: str, color: Rgb, *, is_shown: bool = True) -> None:
        """Append a point of a tick; `is_shown` says whether its label is seen without hovering over it."""
        self._ticks.append(tick)
        self._positions_m.append(position_world_m)
        self._labels.append(label)
        self._are_shown.append(is_shown and bool(label))
        self._colors.append(color)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting points, if any, and forget them."""
        if not self._ticks:
            return
        columns = rr.Points3D.columns(
            positions=np.array(self._positions_m, dtype=np.float32),
            labels=self._labels,
            colors=np.array(self._colors, dtype=np.uint8),
            radii=np.full(len(self._ticks), self._radius_m, dtype=np.float32),
            show_labels=self._are_shown,
        )
        # Several rows may share a tick; the viewer shows every row of its visible time range.
        file.send(self._entity, self._ticks, columns)
        self._ticks, self._positions_m, self._labels, self._are_shown, self._colors = [], [], [], [], []


class TextRows:
    """Lines of a text log."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._texts: list[str] = []
        self._levels: list[str] = []

    def add(self, tick: int, text: str, level: str) -> None:
        """Append a line at a tick."""
        self._ticks.append(tick)
        self._texts.append(text)
        self._levels.append(level)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting lines, if any, and forget them."""
        if self._ticks:
            file.send(self._entity, self._ticks, rr.TextLog.columns(text=self._texts, level=self._levels))
            self._ticks, self._texts, self._levels = [], [], []


class FilamentRows:
    """Filaments as what they are: Gaussian puffs, drawn with their own standard deviation.

    Colour is the mixing ratio at the centre, ppm0 (sigma0 / sigma)^3; peak opacity goes with the amount of gas along
    a line of sight through the centre, (sigma0 / sigma)^2 (our derivation: the integral of a Gaussian puff of constant
    mass along a line falls with sigma^-2). `ppm0` and `sigma0` are those of the first source of the scenario.
    """

    def __init__(self, entity: str, scenario: Scenario) -> None:
        self._entity = entity
        source = scenario.gas.sources[0]
        self._birth_sigma_m = source.sigma_m
        self._birth_ppm = source.ppm
        self._scale = GasScale.of(scenario)
        # Packed as 0xRRGGBB00, which Rerun takes with the opacity and without looking at every colour.
        self._colors = gas_colors().astype(np.uint32) @ np.array([1 << 24, 1 << 16, 1 << 8], dtype=np.uint32)
        self._ticks: list[int] = []
        self._clouds: list[FilamentCloud] = []

    def add(self, tick: int, cloud: FilamentCloud) -> None:
        """Append a snapshot of the cloud at a tick."""
        self._ticks.append(tick)
        self._clouds.append(cloud)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting snapshots, if any, and forget them."""
        if not self._ticks:
            return
        counts = [cloud.sigma_m.shape[0] for cloud in self._clouds]
        strides = [max(1, -(-count // MAX_FILAMENTS)) for count in counts]
        centres_m = np.concatenate(
            [c.position_world_m.to_array()[::s] for c, s in zip(self._clouds, strides, strict=True)]
        )
        sigmas_m = np.concatenate([c.sigma_m.to_array()[::s] for c, s in zip(self._clouds, strides, strict=True)])
        drawn = [-(-count // stride) for count, stride in zip(counts, strides, strict=True)]
        columns = rr.GaussianSplats3D.columns(
            centers=np.ascontiguousarray(centres_m, dtype=np.float32),
            scales=np.repeat(sigmas_m.astype(np.float32), 3).reshape(-1, 3),
            colors=self._rgba(sigmas_m, np.repeat(strides, drawn)),
        )
        file.send(self._entity, self._ticks, columns.partition(drawn))
        self._ticks, self._clouds = [], []

    def _rgba(self, sigmas_m: NDArray[np.float32], strides: NDArray[np.int64]) -> NDArray[np.uint32]:
        shrink = np.float32(self._birth_sigma_m) / np.maximum(sigmas_m, np.float32(self._birth_sigma_m))
        levels = self._scale.levels(self._birth_ppm * shrink**3)
        alpha = np.clip(BIRTH_OPACITY * 255 * strides * shrink**2, 2, 255)
        return self._colors[levels] | alpha.astype(np.uint32)


class SliceRows:
    """A horizontal slice through the gas at its height: the levels of `GasScale`, which the viewer colours."""

    def __init__(self, entity: str, scale: GasScale) -> None:
        self._entity = entity
        self._scale = scale
        self._is_placed = False
        self._ticks: list[int] = []
        self._slices: list[ConcentrationSlice] = []

    def add(self, tick: int, concentration: ConcentrationSlice) -> None:
        """Append a slice at a tick."""
        self._ticks.append(tick)
        self._slices.append(concentration)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting slices, if any, and forget them."""
        if not self._ticks:
            return
        if not self._is_placed:
            self._place(file, self._slices[0])
        pictures = np.concatenate([self._picture(item) for item in self._slices]).reshape(len(self._ticks), -1)
        file.send(self._entity, self._ticks, rr.GridMap.columns(data=pictures))
        self._ticks, self._slices = [], []

    def _place(self, file: RecordingFile, first: ConcentrationSlice) -> None:
        nx, ny = first.mixing_ratio_ppm.shape
        place = rr.GridMap.from_fields(
            format=level_format(nx, ny),
            colormap=GAS_COLORMAP,
            cell_size=first.cell_m,
            translation=(*first.origin_m, slice_height_m(first.height_m)),
        )
        file.draw(self._entity, place)
        self._is_placed = True

    # Rows of a picture run from the far side (largest y) to the near one.
    def _picture(self, concentration: ConcentrationSlice) -> NDArray[np.uint8]:
        levels = self._scale.levels(concentration.mixing_ratio_ppm.to_array())
        return np.ascontiguousarray(levels.T[::-1]).ravel()
