"""Table of the recording's streams: for each the function that makes columns of a Rerun archetype from its rows."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import CameraImage, Quaternion
from gslcosim.environment.model import Box
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.colors import Rgb
from gslcosim_services.recorder.scene import image_format
from gslcosim_services.recorder.stream_table import Stream

Archetype = Callable[[Sequence[Any]], Iterable[rr.ComponentColumn]]

WAYPOINT_RADIUS_M = 0.06
MARKER_RADIUS_M = 0.12
SOURCE_RADIUS_M = 0.14
# The descriptor that `rr.Scalars.columns` gives its column.
_SCALARS = next(iter(rr.Scalars.columns(scalars=[0.0]))).component_descriptor()
_POINT_TYPE: Any = pa.list_(pa.field("item", pa.float32(), nullable=False), 3)
_STRIP_TYPE: Any = pa.list_(pa.field("item", _POINT_TYPE, nullable=False))


class Marker(NamedTuple):
    """A point with a text, which may be empty; without `is_shown` the text appears only under the pointer."""

    position_world_m: Vec3
    label: str
    color: Rgb
    is_shown: bool = True


class Splats(NamedTuple):
    """Filaments of one tick: (n, 3) centres, world frame [m], (n,) standard deviations [m], (n,) colours 0xRRGGBBAA."""

    centres_m: NDArray[np.float32]
    sigmas_m: NDArray[np.float32]
    rgba: NDArray[np.uint32]


class Picture(NamedTuple):
    """Flat RGBA picture in the world: (height, width, 4) pixels, its cells [m] and its corner, world frame [m]."""

    rgba: NDArray[np.uint8]
    cell_m: float
    corner_m: Vec3


class CameraView(NamedTuple):
    """Image of a camera with the camera's pose in the world frame at its exposure."""

    image: CameraImage
    position_m: NDArray[np.float64]
    quaternion_xyzw: tuple[float, float, float, float]


# Each function below takes the items of all rows, one item a row.
# Scalars are built by hand: `rr.Scalars.columns` splits its columns into rows twice, and takes three times as long.


def scalars(items: Sequence[float], lengths: Sequence[int] | None = None) -> list[rr.ComponentColumn]:
    """One number a row; several with `lengths`."""
    numbers = rr.components.ScalarBatch(np.array(items, dtype=np.float64))
    return [rr.ComponentColumn(_SCALARS, numbers, lengths=lengths)]


def curves(items: Sequence[Sequence[float]]) -> list[rr.ComponentColumn]:
    """Numbers of a reading."""
    return scalars([*chain.from_iterable(items)], [*map(len, items)])


def vectors(items: Sequence[Sequence[float]], *, component: str) -> rr.ComponentColumnList:
    """Numbers that no plot draws, in single precision."""
    numbers: Any = pa.array(np.array(items, dtype=np.float32).ravel())
    width = len(items[0])
    rows: Any = numbers if width == 1 else pa.FixedSizeListArray.from_arrays(numbers, width)
    return rr.AnyValues.columns(**{component: rows})


def poses(items: Sequence[tuple[Vec3, Quaternion]]) -> rr.ComponentColumnList:
    """Position and quaternion wxyz, world from body."""
    positions_m, quaternions_wxyz = zip(*items, strict=True)
    # Rerun's order is (x, y, z, w).
    quaternions_xyzw = np.roll(np.array(quaternions_wxyz, dtype=np.float32), -1, axis=1)
    return rr.Transform3D.columns(translation=np.array(positions_m, np.float32), quaternion=quaternions_xyzw)


def strips(items: Sequence[Sequence[Vec3]]) -> rr.ComponentColumnList:
    """Points of one line."""
    # Rerun would make an array of each strip in a list; this is the type in which it stores them.
    flat = pa.array(np.array([*chain.from_iterable(items)], dtype=np.float32).ravel())
    ends = pa.array(np.cumsum([0, *map(len, items)], dtype=np.int32))
    points = pa.FixedSizeListArray.from_arrays(flat, type=_POINT_TYPE)
    return rr.LineStrips3D.columns(strips=pa.ListArray.from_arrays(ends, points, type=_STRIP_TYPE))


def rays(items: Sequence[NDArray[np.floating]]) -> rr.ComponentColumnList:
    """(n, 2, 3) ends of rays."""
    columns = rr.LineStrips3D.columns(strips=list(np.concatenate(items).astype(np.float32)))
    return columns.partition([len(ends_m) for ends_m in items])


def clouds(items: Sequence[NDArray[np.floating]]) -> rr.ComponentColumnList:
    """(n, 3) points."""
    return rr.Points3D.columns(positions=np.concatenate(items)).partition([len(cloud) for cloud in items])


def markers(items: Sequence[Marker], *, radius_m: float) -> rr.ComponentColumnList:
    """Points that stay. Several rows may share a tick: the viewer shows every row of its range."""
    return rr.Points3D.columns(
        positions=np.array([item.position_world_m for item in items], dtype=np.float32),
        labels=[item.label for item in items],
        colors=np.array([item.color for item in items], dtype=np.uint8),
        radii=np.full(len(items), radius_m, dtype=np.float32),
        show_labels=[item.is_shown and bool(item.label) for item in items],
    )


def texts(items: Sequence[tuple[str, str]]) -> rr.ComponentColumnList:
    """Line of a log, with its level."""
    return rr.TextLog.columns(text=[text for text, _ in items], level=[level for _, level in items])


def states(items: Sequence[str]) -> rr.ComponentColumnList:
    """State that lasts until the next row."""
    return rr.StateChange.columns(state=items)


def splats(items: Sequence[Splats]) -> rr.ComponentColumnList:
    """Filaments as Gaussian puffs."""
    columns = rr.GaussianSplats3D.columns(
        centers=np.concatenate([item.centres_m for item in items]),
        scales=np.repeat(np.concatenate([item.sigmas_m for item in items]), 3).reshape(-1, 3),
        colors=np.concatenate([item.rgba for item in items]),
    )
    return columns.partition([len(item.sigmas_m) for item in items])


def levels(items: Sequence[NDArray[np.uint8]]) -> rr.ComponentColumnList:
    """Flat picture of levels of gas, whose place and colours are drawn once."""
    return rr.GridMap.columns(data=np.stack(items))


def pictures(items: Sequence[Picture]) -> rr.ComponentColumnList:
    """Flat picture, each with a place and a size of its own."""
    return rr.GridMap.columns(
        data=[item.rgba.tobytes() for item in items],
        format=[image_format(item.rgba.shape[1], item.rgba.shape[0], color_model="RGBA") for item in items],
        cell_size=[item.cell_m for item in items],
        translation=[item.corner_m for item in items],
    )


def views(items: Sequence[CameraView]) -> list[rr.ComponentColumn]:
    """Encoded image, and the pose of its camera."""
    blobs, encoding = [item.image.data for item in items], items[0].image.encoding
    if encoding == "depth_png":
        images = rr.EncodedDepthImage.columns(blob=blobs, media_type=["image/png"] * len(blobs))
    else:
        images = rr.EncodedImage.columns(blob=blobs, media_type=[f"image/{encoding}"] * len(blobs))
    cameras = rr.Transform3D.columns(
        translation=np.array([item.position_m for item in items], dtype=np.float32),
        quaternion=np.array([item.quaternion_xyzw for item in items], dtype=np.float32),
    )
    return [*images, *cameras]


def arrows(items: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]]) -> rr.ComponentColumnList:
    """(n, 3) origins and (n, 3) vectors."""
    columns = rr.Arrows3D.columns(
        origins=np.concatenate([origins_m for origins_m, _ in items]),
        vectors=np.concatenate([vectors_m for _, vectors_m in items]),
    )
    return columns.partition([len(origins_m) for origins_m, _ in items])


def boxes(items: Sequence[Box | None]) -> rr.ComponentColumnList:
    """Box, or none from this tick on."""
    shown = [box for box in items if box is not None]
    low_m = np.array([box.min_m for box in shown]).reshape(-1, 3)
    high_m = np.array([box.max_m for box in shown]).reshape(-1, 3)
    columns = rr.Boxes3D.columns(centers=(low_m + high_m) / 2, half_sizes=(high_m - low_m) / 2)
    return columns.partition([int(box is not None) for box in items])


ARCHETYPES: Mapping[Stream, Archetype] = {
    **dict.fromkeys((streams.MIXING_RATIO, streams.TRUE_WIND_SPEED, streams.WIND_SPEED), scalars),
    **dict.fromkeys((*streams.FIGURES, streams.NOTE_VALUES, streams.SERVICES), scalars),
    **dict.fromkeys(streams.LOGS, texts),
    **{
        stream: partial(vectors, component=stream.component)
        for stream in (streams.TRUE_WIND, streams.APPARENT_WIND, streams.WIND_FROM)
    },
    streams.TRACK: poses,
    streams.TRACK_LINE: strips,
    streams.PLANNED_PATH: strips,
    streams.WAYPOINTS: partial(markers, radius_m=WAYPOINT_RADIUS_M),
    streams.MARKS: partial(markers, radius_m=MARKER_RADIUS_M),
    streams.SOURCE_MARKS: partial(markers, radius_m=SOURCE_RADIUS_M),
    streams.BELIEF: pictures,
    streams.NOTE_MODE: states,
    streams.POINT_CLOUDS: clouds,
    streams.RAYS: rays,
    streams.PICTURES: views,
    streams.FILAMENTS: splats,
    streams.SLICES: levels,
    streams.WIND_ARROWS: arrows,
    streams.DOORS: boxes,
}
"""Archetype of each stream; those of sensors that are not listed have the numbers of a reading: `curves`."""
