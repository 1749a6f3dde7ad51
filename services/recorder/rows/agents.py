"""Rows of one agent: its vehicle, waypoints, sensor readings and score, beliefs, and columns that no view draws."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from gslcosim.base.quantities import Vec3
from gslcosim.contract.messages import (
    AgentScore,
    Belief,
    BeliefScore,
    BodyState,
    Command,
    MountSample,
    Note,
    Observation,
    Reading,
    Waypoint,
)
from gslcosim.scenario.models.sensors import (
    CameraSensorSpec,
    LidarSensorSpec,
    RaySensorSpec,
    SensorSpec,
    TdlasSensorSpec,
)
from gslcosim_services.recorder import colors
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.entities import AgentEntities
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.columns import (
    MARKER_RADIUS_M,
    WAYPOINT_RADIUS_M,
    CurveRows,
    Marker,
    MarkerRows,
    PlanRows,
    PoseRows,
    Rows,
    ScalarRows,
    TrackRows,
    split_columns,
)
from gslcosim_services.recorder.rows.onboard_sensors import ImageRows, LidarRows, PoseHistory, RayRows, RowTiming
from gslcosim_services.recorder.scene import draw_vehicle, image_format, slice_height_m
from gslcosim_services.recorder.stream_table import Stream, split_values


class WindColumnRows(Rows[Sequence[float]]):
    """Column of an anemometer that no curve draws, in single precision: a wind, or where it is from.

    Args:
        stream: Which it is; its component is the column's name.
    """

    def __init__(self, entity: str, stream: Stream) -> None:
        super().__init__(entity)
        self._column = stream.component

    def _columns(self, items: Sequence[Sequence[float]]) -> rr.ComponentColumnList:
        numbers: Any = pa.array(np.array(items, dtype=np.float32).ravel())
        width = len(items[0])
        rows: Any = numbers if width == 1 else pa.FixedSizeListArray.from_arrays(numbers, width)
        return rr.AnyValues.columns(**{self._column: rows})


class AnemometerRows:
    """Wind at an anemometer, true or as it reports it: its speed as a curve, and the rest as a column beside the plots.

    Args:
        rest: That of the rest: a vector, or where the wind is from, then behind the speed.
    """

    def __init__(self, names: AgentEntities, sensor: str, speed: Stream, rest: Stream) -> None:
        self._speed = ScalarRows(names.at(speed, sensor=sensor))
        self._rest = WindColumnRows(names.at(rest, sensor=sensor), rest)
        self._stream = rest

    def extend(self, ticks: Sequence[int], values: Sequence[Sequence[float]]) -> None:
        """Append values at the ends of ticks."""
        if self._stream is streams.WIND_FROM:
            self._speed.extend(ticks, [part[0] for part in values])
            values = [part[1:] for part in values]
        elif self._stream is streams.TRUE_WIND:
            self._speed.extend(ticks, [math.sqrt(u * u + v * v + w * w) for u, v, w in values])
        else:
            self._speed.extend(ticks, [math.hypot(*wind_m_s) for wind_m_s in values])
        self._rest.extend(ticks, values)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        self._speed.send(file)
        self._rest.send(file)


class BeliefPictureRows(Rows[Belief]):
    """A belief as a picture at its height: brightest in the most probable cell, by the square root of the probability.

    A belief in space is drawn as its sum over the height.
    """

    def __init__(self, entity: str, height_m: float) -> None:
        super().__init__(entity)
        self._height_m = height_m
        self._colors = colors.belief_colors()

    def send(self, file: RecordingFile) -> None:
        """Write the waiting beliefs one by one, as each has a grid of its own, and forget them."""
        for tick, belief in zip(self._ticks, self._items, strict=True):
            file.send(self._entity, [tick], self._columns([belief]))
        self._ticks, self._items = [], []

    def _columns(self, items: Sequence[Belief]) -> rr.ComponentColumnList:
        (belief,) = items
        p = sum_over_height(belief)
        levels = (np.sqrt(p / p.max()) * (colors.N_LEVELS - 1)).astype(np.uint8)
        return rr.GridMap.columns(
            # Rows of a picture run from the far side (largest y) to the near one.
            data=[self._colors[levels.T[::-1]].tobytes()],
            format=[image_format(*p.shape, color_model="RGBA")],
            cell_size=[belief.cell_m],
            translation=[(*belief.origin_m[:2], slice_height_m(self._height_m))],
        )


class BeliefRows:
    """Rows of one agent's beliefs: pictures, and curves of their score."""

    def __init__(self, names: AgentEntities) -> None:
        self._names = names
        self.picture = BeliefPictureRows(names.at(streams.BELIEF), names.agent.vehicle.search_height_m)
        self.mass_near = ScalarRows(names.at(streams.BELIEF_MASS))
        self.expected_distance = ScalarRows(names.at(streams.BELIEF_DISTANCE))
        self.has_any = False
        self._last: BeliefScore | None = None

    def all(self) -> tuple[Rows[Any], ...]:
        """Return the rows of every entity."""
        return self.picture, self.mass_near, self.expected_distance

    def note_belief(self, tick: int, belief: Belief) -> None:
        """Take note of what the agent has published."""
        self.has_any = True
        self.picture.add(tick, belief)

    def note_score(self, tick: int, score: BeliefScore) -> None:
        """Take note of how good its last belief is, where that is news."""
        if score != self._last:
            self.mass_near.add(tick, score.mass_near_frac)
            self.expected_distance.add(tick, score.expected_distance_m)
            self._last = score

    def draw(self, file: RecordingFile, *, label: str) -> None:
        """Say how the curves look; `label` precedes their names."""
        names = self._names
        styles = {streams.BELIEF_MASS: "belief near the source", streams.BELIEF_DISTANCE: "expected by belief"}
        for stream, text in styles.items():
            shade = colors.plan_color(names.color)
            file.draw(names.at(stream), rr.SeriesLines(names=[f"{label}{text}"], colors=[shade], widths=[1.5]))


class NoteRows:
    """Notes of a method: its mode as a lane that changes, and each of its numbers as a curve."""

    def __init__(self, names: AgentEntities) -> None:
        self._names = names
        self._mode = ""
        self._changes: list[tuple[int, str]] = []
        self._values: dict[str, ScalarRows] = {}
        self.has_any = False

    def add(self, tick: int, note: Note) -> None:
        """Append what was noted with the answer to the observation of a tick."""
        self.has_any = True
        if note.mode != self._mode:
            self._mode = note.mode
            self._changes.append((tick, note.mode))
        for name, value in note.values.items():
            if name not in self._values:
                self._values[name] = ScalarRows(self._names.at(streams.NOTE_VALUES, value=name))
            self._values[name].add(tick, value)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._changes:
            ticks, modes = zip(*self._changes, strict=True)
            file.send(self._names.at(streams.NOTE_MODE), ticks, rr.StateChange.columns(state=modes))
            self._changes = []
        for rows in self._values.values():
            rows.send(file)


def sum_over_height(belief: Belief) -> NDArray[np.float64]:
    """Return the (nx, ny) probabilities of a belief, summed over the height where it is in space."""
    p = belief.probability.to_array().astype(np.float64)
    return p.sum(axis=2) if p.ndim == 3 else p


SpaceRows = LidarRows | RayRows | ImageRows


class AgentRows:
    """All rows of one agent. `gases` are those of the run, `tick_ns` is its tick."""

    def __init__(self, names: AgentEntities, gases: tuple[str, ...], tick_ns: int) -> None:
        self.names = names
        self._tick_ns = tick_ns
        self._poses = PoseHistory(names.agent.sensors, tick_ns)
        self.pose = PoseRows(names.at(streams.TRACK))
        self.track = TrackRows(names.at(streams.TRACK_LINE))
        self.plan = PlanRows(names.at(streams.PLANNED_PATH))
        self.waypoints = MarkerRows(names.at(streams.WAYPOINTS), radius_m=WAYPOINT_RADIUS_M)
        self.markers = MarkerRows(names.at(streams.MARKS), radius_m=MARKER_RADIUS_M)
        self.distance = ScalarRows(names.at(streams.DISTANCE))
        self.tracking_error = ScalarRows(names.at(streams.TRACKING_ERROR))
        self.decision = ScalarRows(names.at(streams.DECISION_TIME))
        self.belief = BeliefRows(names)
        self.notes = NoteRows(names)
        self.position_m: Vec3 = names.agent.vehicle.start_m
        self._mission: tuple[Waypoint, ...] | None = None
        self._gas = {
            (sensor.name, gas): ScalarRows(names.at(streams.MIXING_RATIO, sensor=sensor.name, gas=gas))
            for sensor in names.gas_sensors
            for gas in gases
        }
        self._true_wind = {
            sensor.name: AnemometerRows(names, sensor.name, streams.TRUE_WIND_SPEED, streams.TRUE_WIND)
            for sensor in names.wind_sensors
        }
        lasers = [sensor for sensor in names.gas_sensors if isinstance(sensor, TdlasSensorSpec)]
        self._beams = {sensor.name: self._beam_rows(sensor) for sensor in lasers}
        self._in_space = {
            sensor.name: rows for sensor, _ in names.on_board_sensors if (rows := self._space_rows(sensor))
        }
        self._readings = self._reading_rows()
        self.shows_space = bool(self._in_space or self._beams)

    def all(self) -> list[Rows[Any] | AnemometerRows | NoteRows]:
        """Return the rows of every entity."""
        own = (self.pose, self.track, self.plan, self.waypoints, self.markers, self.distance, self.tracking_error)
        own = (*own, self.decision, self.notes)
        own = (*own, *self.belief.all())
        truth = (*self._gas.values(), *self._true_wind.values(), *self._beams.values())
        readings = (rows for all_rows in self._readings.values() for rows in all_rows)
        return [*own, *truth, *readings, *self._in_space.values()]

    def draw(self, file: RecordingFile, *, label: str) -> None:
        """Draw the vehicle and say how lines and curves look; `label` precedes the names of curves."""
        names = self.names
        # A name beside the only vehicle would hide what it comes to.
        draw_vehicle(file, names.at(streams.TRACK), names.agent, names.color, is_named=bool(label))
        file.draw(names.at(streams.TRACK_LINE), rr.LineStrips3D.from_fields(colors=[names.color], radii=[0.035]))
        if names.agent.vehicle.avoidance != "none":
            color = colors.plan_color(names.color)
            file.draw(names.at(streams.PLANNED_PATH), rr.LineStrips3D.from_fields(colors=[color], radii=[0.015]))
        for rows in (*self._in_space.values(), *self._beams.values()):
            rows.draw(file)
        for entity, names_and_colors in self._styles(label).items():
            labels, shades = zip(*names_and_colors, strict=True)
            file.draw(entity, rr.SeriesLines(names=labels, colors=shades, widths=[1.5] * len(labels)))

    def note_space(
        self, tick: int, body: BodyState | None, samples: Iterable[MountSample], observation: Observation | None
    ) -> None:
        """Take note of what sensors see around the vehicle, while the pose is known from which they have seen it.

        Args:
            samples: The truth at the sensors of all vehicles.
        """
        if body is not None:
            self._poses.add(tick, body)
        for sample in samples if self._beams else ():
            if sample.agent == self.names.agent.name and sample.beam_m is not None and sample.sensor in self._beams:
                self._beams[sample.sensor].add_ranges(tick, (sample.beam_m,), tick)
        for reading in observation.readings if observation else ():
            rows = self._in_space.get(reading.sensor)
            if rows is not None:
                rows.add_reading(tick, reading)

    def note_bodies(self, ticks: Sequence[int], bodies: Sequence[BodyState]) -> None:
        """Take note of where the vehicle is at the ends of ticks."""
        positions_m = [body.position_world_m for body in bodies]
        self.pose.extend(ticks, [(body.position_world_m, body.quaternion_wxyz) for body in bodies])
        self.track.add_positions(ticks, positions_m)
        self.plan.add_paths(ticks, positions_m, [body.planned_path_world_m for body in bodies])
        errors_m = [error_m for body in bodies if (error_m := body.tracking_error_m) is not None]
        if len(errors_m) < len(bodies):
            ticks = [tick for tick, body in zip(ticks, bodies, strict=True) if body.tracking_error_m is not None]
        self.tracking_error.extend(ticks, errors_m)

    def note_samples(self, sensor: str, ticks: Sequence[int], samples: Sequence[MountSample]) -> None:
        """Take note of the truth at a sensor at the ends of ticks."""
        rows = self._true_wind.get(sensor)
        if rows is not None:
            rows.extend(ticks, [sample.wind_world_m_s for sample in samples])
            return
        for gas, (gas_ticks, amounts) in split_columns(ticks, [sample.gases for sample in samples], "gas"):
            if (sensor, gas) in self._gas:
                self._gas[sensor, gas].extend(gas_ticks, [amount.mixing_ratio_ppm for amount in amounts])

    def note_readings(self, sensor: str, ticks: Sequence[int], readings: Sequence[Reading]) -> None:
        """Take note of what a sensor reports at the ends of ticks, where it means something."""
        all_rows = self._readings.get(sensor)
        if not all_rows:
            return
        if any(reading.is_warming_up for reading in readings):
            meaningful = [noted for noted in zip(ticks, readings, strict=True) if not noted[1].is_warming_up]
            ticks, readings = [tick for tick, _ in meaningful], [reading for _, reading in meaningful]
        values = [reading.values for reading in readings]
        for rows in all_rows:
            rows.extend(ticks, values)

    def note_scores(self, ticks: Sequence[int], standings: Sequence[AgentScore]) -> None:
        """Take note of the referee's scores of it at the ends of ticks."""
        self.distance.extend(ticks, [standing.distance_to_source_m for standing in standings])
        for tick, standing in zip(ticks, standings, strict=True):
            if standing.belief is not None:
                self.belief.note_score(tick, standing.belief)

    def note_command(self, tick: int, command: Command) -> None:
        """Take note of where the vehicle is sent, of declarations, beliefs and notes."""
        if command.note is not None:
            self.notes.add(tick, command.note)
        if command.belief is not None:
            self.belief.note_belief(tick, command.belief)
        if command.kind == "waypoint" and command.position_world_m is not None:
            self.waypoints.add(tick, Marker(command.position_world_m, "", self.names.color))
        elif command.kind == "mission" and command.waypoints != self._mission:
            self._mission = command.waypoints
            for point in command.waypoints or ():
                self.waypoints.add(tick, Marker(point.position_world_m, "", self.names.color))
        elif command.kind == "declare_source" and command.declaration is not None:
            place_m = command.declaration.position_world_m
            self.markers.add(tick, Marker(place_m, "declared", self.names.color))

    def _reading_rows(self) -> Mapping[str, tuple[CurveRows | AnemometerRows, ...]]:
        names = self.names
        rows: dict[str, tuple[CurveRows | AnemometerRows, ...]] = {}
        for sensor in names.gas_sensors:
            # The first number of a reading is what a gas sensor reports.
            rows[sensor.name] = (CurveRows(names.at(streams.RESPONSE, sensor=sensor.name), slice(1)),)
        for sensor in names.wind_sensors:
            rest = streams.WIND_FROM if sensor.name in names.bearing_sensors else streams.APPARENT_WIND
            rows[sensor.name] = (AnemometerRows(names, sensor.name, streams.WIND_SPEED, rest),)
        for sensor, own in names.on_board_sensors:
            entities = [names.at(stream, sensor=sensor.name) for stream in own]
            parts = zip(entities, split_values(own), strict=True)
            rows[sensor.name] = tuple(CurveRows(entity, part) for entity, part in parts)
        return rows

    # Names and colours of each entity's curves.
    def _styles(self, label: str) -> dict[str, list[tuple[str, colors.Rgb]]]:
        names = self.names
        styles = {
            names.at(streams.DISTANCE): [(label.strip() or "distance", names.color)],
            names.at(streams.TRACKING_ERROR): [(label.strip() or "error", names.color)],
            names.at(streams.DECISION_TIME): [(label.strip() or "decision", names.color)],
        }
        n_gases = len({gas for _, gas in self._gas})
        for i, (sensor, gas) in enumerate(self._gas):
            of_gas = f" {gas}" if n_gases > 1 else ""
            entity = names.at(streams.MIXING_RATIO, sensor=sensor, gas=gas)
            styles[entity] = [(f"{label}{sensor}{of_gas}", colors.shade(names.color, i))]
        for i, sensor in enumerate(names.gas_sensors):
            entity = names.at(streams.RESPONSE, sensor=sensor.name)
            styles[entity] = [(f"{label}{sensor.name}", colors.shade(names.color, i))]
        for i, sensor in enumerate(names.wind_sensors):
            of_sensor = f"{sensor.name} " if len(names.wind_sensors) > 1 else ""
            measured = colors.shade(names.color if label else colors.WIND, i)
            styles[names.at(streams.WIND_SPEED, sensor=sensor.name)] = [(f"{label}{of_sensor}measured", measured)]
            styles[names.at(streams.TRUE_WIND_SPEED, sensor=sensor.name)] = [(f"{label}{of_sensor}true", colors.TRUTH)]
        for sensor, own in names.on_board_sensors:
            for stream in own:
                if stream.axes:
                    drawn = [(axis, colors.axis_color(axis, i)) for i, axis in enumerate(stream.axes)]
                    styles[names.at(stream, sensor=sensor.name)] = drawn
        return styles

    def _space_rows(self, sensor: SensorSpec) -> SpaceRows | None:
        entity, timing = self.names.at(streams.POINT_CLOUDS, sensor=sensor.name), RowTiming(sensor, self._tick_ns)
        if isinstance(sensor, LidarSensorSpec):
            return LidarRows(entity, sensor, self._poses, timing, self.names.color)
        if isinstance(sensor, RaySensorSpec):
            return RayRows(entity, sensor, self._poses, timing, self.names.color)
        return (
            ImageRows(entity, sensor, self._poses, self.names.color) if isinstance(sensor, CameraSensorSpec) else None
        )

    def _beam_rows(self, sensor: TdlasSensorSpec) -> RayRows:
        direction = np.array([sensor.beam_body]) / np.linalg.norm(sensor.beam_body)
        entity, timing = self.names.at(streams.POINT_CLOUDS, sensor=sensor.name), RowTiming(sensor, self._tick_ns)
        return RayRows(entity, sensor, self._poses, timing, self.names.color, direction)
