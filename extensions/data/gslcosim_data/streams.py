"""Streams of a recording as arrays, each decoded on demand; names carry units, frames are the world's."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract.messages import Belief
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import SensorSpec
from gslcosim_data.recording_reader import RecordedColumn, RecordingReader, SliceDecoder, read_picture_grid, read_puffs
from gslcosim_services.recorder.colors import GasScale
from gslcosim_services.recorder.entities import AgentEntities, get_unit, list_gas_names
from gslcosim_services.recorder.stream_table import (
    APPARENT_WIND,
    DOORS,
    FIGURES,
    FILAMENTS,
    MIXING_RATIO,
    PICTURES,
    POINT_CLOUDS,
    POINTS,
    RAYS,
    RESPONSE,
    SERVICES,
    SLICES,
    TRACK,
    TRACK_ATTITUDE,
    TRUE_WIND,
    TRUE_WIND_SPEED,
    WIND_FROM,
    WIND_SPEED,
    Stream,
)

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
# In recordings of older versions what an anemometer's curve does not draw is beside it, as bytes of this component.
_BYTES_COMPONENT = "numbers"


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """Base of what was recorded over time.

    Attributes:
        tick: (n,) ascending.
        time_s: (n,) [s].
    """

    tick: Ints
    time_s: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedTrack(Recorded):
    """Track of a vehicle: its pose at the end of each tick.

    Attributes:
        position_world_m: (n, 3) [m].
        quaternion_wxyz: (n, 4) world from body, unit length.
    """

    agent: str
    position_world_m: Floats
    quaternion_wxyz: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSeries(Recorded):
    """Numbers over time: what a sensor is exposed to or reports, or a figure of the referee.

    Attributes:
        agent: Whose; empty where it is nobody's.
        sensor: Of which sensor; empty where of none.
        quantity: What it is, for example `mixing_ratio`.
        unit: As messages have it, for example `ppm`; empty for pure numbers.
        gas: Which gas, of true mixing ratios; else empty.
        columns: k names with their units, for example `mixing_ratio_ppm`.
        values: (n, k).
    """

    agent: str
    sensor: str
    quantity: str
    unit: str
    columns: tuple[str, ...]
    values: Floats
    gas: str = ""

    @property
    def value(self) -> Floats:
        """The (n,) values of its first column."""
        return self.values[:, 0]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedPoints(Recorded):
    """Places where something happened or somebody was sent; several may share a tick.

    Attributes:
        position_world_m: (n, 3) [m].
        label: n texts, some of them empty.
    """

    position_world_m: Floats
    label: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedTexts(Recorded):
    """Lines of a log: n ticks (ascending), times [s], texts, and levels (`INFO`, `WARN`)."""

    text: tuple[str, ...]
    level: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedDoor(Recorded):
    """A door over time: n ticks (ascending) from which on it is closed or open, and times [s]."""

    is_closed: NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedSlices(Recorded):
    """The gas in one horizontal layer over time.

    Recorded as pictures of 256 levels: a mixing ratio is right within 1.4 % (4 % just above `min_ppm`), and 0 below.

    Attributes:
        gas: Its name.
        origin_m: Corner (x, y) that the first cell touches [m].
        cell_m: Side of a cell [m].
        shape: Cells along x and y.
        height_m: Of the layer [m].
        min_ppm: Below this a mixing ratio is 0 [ppm].
        max_ppm: Above this a mixing ratio is this [ppm].
    """

    gas: str
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
class RecordedFilaments(Recorded):
    """The cloud over time; of snapshot i are the filaments `starts[i]:starts[i + 1]`.

    Of clouds with more than 3000 filaments every k-th was recorded.

    Attributes:
        starts: (n + 1,).
        centre_world_m: (m, 3) [m].
        sigma_m: (m,) standard deviations [m].
    """

    starts: Ints
    centre_world_m: Floats
    sigma_m: Floats

    def snapshot(self, i: int) -> tuple[Floats, Floats]:
        """Return centres (k, 3) and standard deviations (k,) of the i-th snapshot [m]."""
        some = slice(int(self.starts[i]), int(self.starts[i + 1]))
        return self.centre_world_m[some], self.sigma_m[some]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedNotes(Recorded):
    """Notes of a method on its own state: n ticks (ascending), times [s], modes, and (n,) values by name.

    A value is NaN where a note did not have it.
    """

    mode: tuple[str, ...]
    values: Mapping[str, Floats]


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedBeliefs(Recorded):
    """Beliefs about the source, whenever the agent published one; exactly as published.

    Attributes:
        belief: n beliefs; see `gslcosim.contract.messages.Belief`.
    """

    belief: tuple[Belief, ...]

    def in_plane(self, i: int) -> Floats:
        """Return the (nx, ny) probabilities of the i-th belief, summed over the height where it is in space."""
        p = self.belief[i].probability.to_array().astype(np.float64)
        return p.sum(axis=2) if p.ndim == 3 else p


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedShapes(Recorded):
    """Shapes that a sensor saw in the world at some ticks: lidar points, or rays from the sensor to what they met.

    Attributes:
        tick: (n,) ascending, when the reading came.
        time_s: (n,) [s].
        starts: (n + 1,): of reading i are `points_world_m[starts[i]:starts[i + 1]]`.
        points_world_m: (m, 3) points, or (m, 2, 3) rays; a ray that met nothing has no length [m].
    """

    agent: str
    sensor: str
    starts: Ints
    points_world_m: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class RecordedPictures(Recorded):
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


def read_track(rows: RecordingReader, scenario: Scenario, names: AgentEntities) -> RecordedTrack:
    """Return the track of a vehicle."""
    places = rows.column(names.at(TRACK), TRACK.component)
    turns_xyzw = rows.column(names.at(TRACK_ATTITUDE), TRACK_ATTITUDE.component)
    return RecordedTrack(
        agent=names.agent.name,
        tick=places.tick,
        time_s=tick_times_s(places.tick, scenario),
        position_world_m=_floats(places, 3),
        quaternion_wxyz=np.roll(_floats(turns_xyzw, 4), 1, axis=1),
    )


def read_samples(rows: RecordingReader, scenario: Scenario, names: AgentEntities) -> list[RecordedSeries]:
    """Return the truth at an agent's sensors: mixing ratios of all gases, and the wind with its speed."""
    read, found = _SeriesReader(rows, scenario, names), list[RecordedSeries]()
    for sensor in names.gas_sensors:
        for gas in list_gas_names(scenario):
            found += read.series(MIXING_RATIO, sensor=sensor.name, gas=gas)
    for sensor in names.wind_sensors:
        found += read.series(TRUE_WIND_SPEED, sensor=sensor.name)
        found += read.series(TRUE_WIND, sensor=sensor.name) or read.bytes_beside(TRUE_WIND_SPEED, sensor, TRUE_WIND)
    return found


def read_readings(rows: RecordingReader, scenario: Scenario, names: AgentEntities) -> list[RecordedSeries]:
    """Return the readings of an agent's sensors; nothing of the time in which they warmed up."""
    read, found = _SeriesReader(rows, scenario, names), list[RecordedSeries]()
    for sensor in names.gas_sensors:
        found += read.series(replace(RESPONSE, unit=get_unit(sensor, scenario)), sensor=sensor.name)
    for sensor in names.wind_sensors:
        rest, skipped = (WIND_FROM, 1) if sensor.name in names.bearing_sensors else (APPARENT_WIND, 0)
        found += read.series(WIND_SPEED, sensor=sensor.name)
        found += read.series(rest, sensor=sensor.name) or read.bytes_beside(WIND_SPEED, sensor, rest, skipped=skipped)
    for sensor, streams in names.on_board_sensors:
        for stream in streams:
            found += read.series(stream, sensor=sensor.name)
    return found


def read_figures(rows: RecordingReader, scenario: Scenario, names: AgentEntities) -> list[RecordedSeries]:
    """Return the curves that are no sensor's: `distance`, `tracking_error`, `decision_time`, and two of beliefs."""
    read = _SeriesReader(rows, scenario, names)
    return [one for stream in FIGURES for one in read.series(stream)]


def read_service_curves(rows: RecordingReader, scenario: Scenario) -> list[RecordedSeries]:
    """Return the outputs of services of other packages; the quantity is the port and the field."""
    found: list[RecordedSeries] = []
    for entity in rows.below(SERVICES.root):
        stream = replace(SERVICES, name=entity.removeprefix(f"{SERVICES.root}/"), entity=entity)
        found += _series(rows.column(entity, stream.component), scenario, stream)
    return found


def read_points(rows: RecordingReader, scenario: Scenario, entity: str) -> RecordedPoints:
    """Return labelled places."""
    places, labels = rows.column(entity, POINTS), rows.column(entity, "Points3D:labels")
    return RecordedPoints(
        tick=places.tick,
        time_s=tick_times_s(places.tick, scenario),
        position_world_m=_floats(places, 3),
        label=tuple(str(label) for label in labels.values),
    )


def read_texts(rows: RecordingReader, scenario: Scenario, log: Stream) -> RecordedTexts:
    """Return the lines of a log."""
    lines, levels = rows.column(log.entity, log.component), rows.column(log.entity, "TextLog:level")
    return RecordedTexts(
        tick=lines.tick,
        time_s=tick_times_s(lines.tick, scenario),
        text=tuple(map(str, lines.values)),
        level=tuple(map(str, levels.values)),
    )


def read_door(rows: RecordingReader, scenario: Scenario, name: str) -> RecordedDoor:
    """Return when a door was closed."""
    boxes = rows.column(DOORS.at(door=name), DOORS.component)
    times = tick_times_s(boxes.tick, scenario)
    return RecordedDoor(tick=boxes.tick, time_s=times, is_closed=np.diff(boxes.starts) > 0)


def read_slices(rows: RecordingReader, scenario: Scenario) -> dict[str, RecordedSlices]:
    """Return the gases in the layer of the map, by name."""
    found: dict[str, RecordedSlices] = {}
    for entity in rows.below(SLICES.root):
        pictures, place = rows.column(entity, SLICES.component), read_picture_grid(rows, entity)
        if place is None:
            continue
        shape, cell_m, (x, y, _) = place
        scale = GasScale.of(scenario)
        decoder, gas = SliceDecoder(shape=shape, scale=scale), entity.removeprefix(f"{SLICES.root}/")
        found[gas] = RecordedSlices(
            gas=gas,
            tick=pictures.tick,
            time_s=tick_times_s(pictures.tick, scenario),
            origin_m=(x, y),
            cell_m=cell_m,
            shape=shape,
            height_m=scenario.slice_height_m,
            min_ppm=scale.min_ppm,
            max_ppm=scale.max_ppm,
            decode=lambda i, pictures=pictures, decoder=decoder: decoder.mixing_ratio_ppm(pictures.values[i]),
        )
    return found


def read_filaments(rows: RecordingReader, scenario: Scenario) -> RecordedFilaments:
    """Return the cloud over time."""
    centres, sigmas = read_puffs(rows, FILAMENTS.entity)
    return RecordedFilaments(
        tick=centres.tick,
        time_s=tick_times_s(centres.tick, scenario),
        starts=centres.starts,
        centre_world_m=_floats(centres, 3),
        sigma_m=_floats(sigmas, 3)[:, 0],
    )


def read_shapes(
    rows: RecordingReader, scenario: Scenario, names: AgentEntities, *, are_rays: bool
) -> list[RecordedShapes]:
    """Return the points of an agent's lidars, or the rays of its range finders and lasers."""
    stream = RAYS if are_rays else POINT_CLOUDS
    root, found = f"{stream.root}/{names.agent.name}", list[RecordedShapes]()
    for entity in rows.below(root):
        column = rows.column(entity, stream.component)
        if not len(column.tick):
            continue
        values = np.asarray(column.values, dtype=np.float64).reshape((-1, 2, 3) if are_rays else (-1, 3))
        found.append(
            RecordedShapes(
                agent=names.agent.name,
                sensor=entity.removeprefix(f"{root}/"),
                tick=column.tick,
                time_s=tick_times_s(column.tick, scenario),
                starts=column.starts,
                points_world_m=values,
            )
        )
    return found


def read_pictures(rows: RecordingReader, scenario: Scenario, names: AgentEntities) -> list[RecordedPictures]:
    """Return the pictures of an agent's cameras."""
    found: list[RecordedPictures] = []
    for camera in names.cameras:
        entity = names.at(PICTURES, sensor=camera.name)
        for kind in ("EncodedImage", "EncodedDepthImage"):
            blobs, media = rows.column(entity, f"{kind}:blob"), rows.column(entity, f"{kind}:media_type")
            if len(blobs.tick):
                found.append(_pictures(rows, scenario, names, entity, blobs, str(media.values[0])))
    return found


def tick_times_s(tick: Ints, scenario: Scenario) -> Floats:
    """Return the simulated times of ticks [s]."""
    return tick * scenario.tick_ns / NS_PER_S


def _pictures(
    rows: RecordingReader, scenario: Scenario, names: AgentEntities, entity: str, blobs: RecordedColumn, media_type: str
) -> RecordedPictures:
    eyes, turns = rows.column(entity, "Transform3D:translation"), rows.column(entity, "Transform3D:quaternion")
    # Column by column, as Rerun has it.
    projection = rows.still(entity, "Pinhole:image_from_camera")[0]
    width, height = rows.still(entity, "Pinhole:resolution")[0]
    return RecordedPictures(
        agent=names.agent.name,
        sensor=entity.rpartition("/")[2],
        tick=blobs.tick,
        time_s=tick_times_s(blobs.tick, scenario),
        media_type=media_type,
        is_depth=rows.still(entity, "EncodedDepthImage:meter") is not None,
        data=tuple(np.asarray(blob).tobytes() for blob in blobs.values),
        position_world_m=_floats(eyes, 3),
        quaternion_wxyz=np.roll(_floats(turns, 4), 1, axis=1),
        size_px=(int(width), int(height)),
        focal_px=(float(projection[0]), float(projection[4])),
        centre_px=(float(projection[6]), float(projection[7])),
    )


@dataclass(frozen=True)
class _SeriesReader:
    """Reads numbers of one agent."""

    rows: RecordingReader
    scenario: Scenario
    names: AgentEntities

    def series(self, stream: Stream, *, sensor: str = "", gas: str = "") -> list[RecordedSeries]:
        """Return a stream, if the recording has it."""
        column = self.rows.column(self.names.at(stream, sensor=sensor, gas=gas), stream.component)
        return _series(column, self.scenario, stream, agent=self.names.agent.name, sensor=sensor, gas=gas)

    def bytes_beside(
        self, curve: Stream, sensor: SensorSpec, stream: Stream, *, skipped: int = 0
    ) -> list[RecordedSeries]:
        """Return a stream that an older recording has as bytes beside a curve, without the first numbers of a row."""
        column = self.rows.column(self.names.at(curve, sensor=sensor.name), _BYTES_COMPONENT)
        n = len(column.tick)
        if not n:
            return []
        numbers = np.frombuffer(b"".join(column.values), dtype="<f4").astype(np.float64).reshape(n, -1)[:, skipped:]
        return _series(
            RecordedColumn(tick=column.tick, starts=column.starts, values=numbers), self.scenario, stream,
            agent=self.names.agent.name, sensor=sensor.name,
        )  # fmt: skip


def _series(
    column: RecordedColumn, scenario: Scenario, stream: Stream, *, agent: str = "", sensor: str = "", gas: str = ""
) -> list[RecordedSeries]:
    n = len(column.tick)
    if not n:
        return []
    values = np.asarray(column.values, dtype=np.float64).reshape(n, -1)
    k = values.shape[1]
    parts = [f"{stream.name} {axis}" for axis in stream.axes] if len(stream.axes) == k and k > 1 else [stream.name]
    if len(parts) != k:
        parts = [f"{stream.name} {i}" for i in range(k)]
    return [
        RecordedSeries(
            agent=agent,
            sensor=sensor,
            quantity=stream.name,
            unit=stream.unit,
            gas=gas,
            columns=tuple(column_name(part, stream.unit) for part in parts),
            tick=column.tick,
            time_s=tick_times_s(column.tick, scenario),
            values=values,
        )
    ]


def _floats(column: RecordedColumn, width: int) -> Floats:
    return np.asarray(column.values, dtype=np.float64).reshape(-1, width)
