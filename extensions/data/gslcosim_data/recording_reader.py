"""Reader of a recording: components of entities by tick as arrays, and pictures as numbers."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from gslcosim.base.errors import RecordingError
from gslcosim_data.chunks import describe_broken_recording, read_chunks
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.colors import GasScale
from gslcosim_services.recorder.recording_file import TICK_TIMELINE

if TYPE_CHECKING:
    from rerun.chunk import Chunk


_Part = tuple[NDArray[np.int64], NDArray[np.int64], Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedColumn:
    """One component over time: the values of row i are `values[starts[i]:starts[i + 1]]`.

    `tick` is (n,), ascending; `starts` (n + 1,). `values` is an array whose first axis runs over the values of all
    rows, or a list of texts or of dictionaries.
    """

    tick: NDArray[np.int64]
    starts: NDArray[np.int64]
    values: Any

    def row(self, i: int) -> Any:
        """Return the values of a row."""
        return self.values[self.starts[i] : self.starts[i + 1]]


class RecordingReader:
    """Reader of the rows of one recording, decoded where they are asked for.

    Args:
        path: A whole recording of gslcosim.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._moving: dict[str, list[Chunk]] = defaultdict(list)
        self._still: dict[str, list[Chunk]] = defaultdict(list)
        for chunk in read_chunks(path):
            kind = self._still if chunk.is_static else self._moving
            kind[str(chunk.entity_path).removeprefix("/")].append(chunk)

    @cached_property
    def entities(self) -> tuple[str, ...]:
        """Paths of all entities that change, sorted."""
        return tuple(sorted(self._moving))

    def below(self, root: str) -> tuple[str, ...]:
        """Return the paths of the entities below a root that change, sorted."""
        return tuple(entity for entity in self.entities if entity.startswith(f"{root}/"))

    def column(self, entity: str, component: str) -> RecordedColumn:
        """Return a component of an entity over time, such as `Scalars:scalars`; without rows where there is none."""
        try:
            parts = [part for chunk in self._moving.get(entity, ()) if (part := _part(chunk, component)) is not None]
        except (RuntimeError, ValueError, pa.ArrowException) as error:
            raise RecordingError(describe_broken_recording(self._path, str(error))) from error
        return _join(parts)

    def still(self, entity: str, component: str) -> Any:
        """Return the values of a component at all times; None where there is none."""
        for chunk in self._still.get(entity, ()):
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                return batch.column(component).to_pylist()[0]
        return None


def _part(chunk: "Chunk", component: str) -> _Part | None:
    batch: Any = chunk.to_record_batch()
    if component not in batch.schema.names:
        return None
    tick = batch.column(TICK_TIMELINE).to_numpy(zero_copy_only=False)
    lists = batch.column(component)
    if lists.null_count:
        # Rows of other components of the entity: a row without this one says nothing of it.
        kept = pa.array(lists.is_valid())
        tick, lists = tick[kept.to_numpy(zero_copy_only=False)], lists.filter(kept)
    counts = np.asarray(lists.value_lengths().to_numpy(zero_copy_only=False), dtype=np.int64)
    return tick, counts, _to_array(lists.flatten())


def _to_array(values: Any) -> Any:
    if pa.types.is_fixed_size_list(values.type):
        inner = _to_array(values.flatten())
        return inner.reshape(len(values), values.type.list_size, *inner.shape[1:])
    if pa.types.is_integer(values.type) or pa.types.is_floating(values.type):
        return values.to_numpy(zero_copy_only=False)
    if pa.types.is_list(values.type) and pa.types.is_integer(values.type.value_type):
        # Bytes of pictures: an array for each.
        flat, ends = values.flatten().to_numpy(zero_copy_only=False), np.cumsum(values.value_lengths().to_numpy())
        return np.split(flat, ends[:-1]) if len(values) else []
    if pa.types.is_list(values.type):
        return [_to_array(each.values) for each in values]
    return values.to_pylist()


def _join(parts: Sequence[_Part]) -> RecordedColumn:
    if not parts:
        nothing = np.zeros(0, dtype=np.int64)
        return RecordedColumn(tick=nothing, starts=np.zeros(1, dtype=np.int64), values=[])
    parts = sorted(parts, key=lambda part: part[0][0] if len(part[0]) else -1)
    tick = np.concatenate([tick for tick, _, _ in parts]).astype(np.int64)
    counts = np.concatenate([counts for _, counts, _ in parts])
    values = _concatenate([values for _, _, values in parts])
    starts = np.concatenate([[0], np.cumsum(counts)])
    if len(tick) > 1 and np.any(np.diff(tick) < 0):
        order = np.argsort(tick, kind="stable")
        pick = np.concatenate([np.arange(int(starts[i]), int(starts[i + 1])) for i in order.tolist()])
        values = values[pick] if isinstance(values, np.ndarray) else [values[i] for i in pick]
        tick, counts = tick[order], counts[order]
        starts = np.concatenate([[0], np.cumsum(counts)])
    return RecordedColumn(tick=tick, starts=starts, values=values)


def _concatenate(all_values: Sequence[Any]) -> Any:
    if isinstance(all_values[0], np.ndarray):
        return np.concatenate(all_values)
    return [value for values in all_values for value in values]


def build_color_levels() -> dict[int, int]:
    """Return the level of each colour of a slice, packed as 0xRRGGBB; of two levels with one colour the lower."""
    packed = _pack_colors(colors.slice_colors()[:, :3])
    return {int(color): level for level, color in reversed(list(enumerate(packed)))}


@dataclass(frozen=True, kw_only=True, eq=False)
class SliceDecoder:
    """Turns the pictures of a gas slice back into mixing ratios.

    A picture has `colors.N_LEVELS` levels over `colors.DECADES` powers of ten. A mixing ratio comes back as the middle
    of its level: within 1.4 %. What was below the scale comes back as 0. Recordings of older versions hold colours, of
    which two levels share one just above the lower end: within 4 % there.
    """

    shape: tuple[int, int]
    scale: GasScale

    def mixing_ratio_ppm(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return the (nx, ny) mixing ratios [ppm] of a picture of levels, or of RGBA bytes."""
        nx, ny = self.shape
        if np.size(picture) == nx * ny:
            return self._ppm_of_levels()[np.asarray(picture).reshape(ny, nx)[::-1].T]
        packed = _pack_colors(np.asarray(picture).reshape(ny, nx, 4)[..., :3])
        known, levels = _palette()
        at = np.searchsorted(known, packed)
        level = levels[np.minimum(at, len(known) - 1)]
        # Rows of a picture run from the far side (largest y) to the near one.
        return self._ppm_of_levels()[level[::-1].T]

    def _ppm_of_levels(self) -> NDArray[np.float32]:
        middle = np.arange(colors.N_LEVELS) + 0.5
        ppm = self.scale.min_ppm * 10.0 ** (middle * colors.DECADES / (colors.N_LEVELS - 1))
        ppm[0], ppm[-1] = 0.0, self.scale.max_ppm
        return ppm.astype(np.float32)


def read_puffs(rows: RecordingReader, entity: str) -> tuple[RecordedColumn, RecordedColumn]:
    """Return centres (n, 3) and standard deviations (n, 3) of filaments over time [m]."""
    return rows.column(entity, "GaussianSplats3D:centers"), rows.column(entity, "GaussianSplats3D:scales")


def read_picture_grid(
    rows: RecordingReader, entity: str
) -> tuple[tuple[int, int], float, tuple[float, float, float]] | None:
    """Return the number of cells of a picture over the map along x and y, their size [m], and its corner [m]."""
    shape: Any = rows.still(entity, "GridMap:format")
    if shape is None:
        return None
    x_m, y_m, z_m = (float(c) for c in rows.still(entity, "GridMap:translation")[0])
    cell_m = float(rows.still(entity, "GridMap:cell_size")[0])
    return (int(shape[0]["width"]), int(shape[0]["height"])), cell_m, (x_m, y_m, z_m)


def _palette() -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    found = build_color_levels()
    known = np.array(sorted(found), dtype=np.int64)
    return known, np.array([found[int(color)] for color in known], dtype=np.int64)


def _pack_colors(rgb: NDArray[np.uint8]) -> NDArray[np.int64]:
    return rgb.astype(np.int64) @ np.array([1 << 16, 1 << 8, 1], dtype=np.int64)
