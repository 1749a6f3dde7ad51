"""Rows of one agent: its vehicle, waypoints, sensor readings and score, beliefs, and columns that no view draws."""

import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
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
from gslcosim_services.recorder.entities import AgentEntities, Curves, wind_speed_m_s
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.columns import (
    MARKER_RADIUS_M,
    WAYPOINT_RADIUS_M,
    CurveRows,
    MarkerRows,
    PlanRows,
    PoseRows,
    ReadingRows,
    Rows,
    ScalarRows,
    TrackRows,
    scalar_columns,
    split_columns,
)
from gslcosim_services.recorder.rows.onboard_sensors import ImageRows, LidarRows, PoseHistory, RayRows, RowTiming
from gslcosim_services.recorder.scene import draw_vehicle, picture_format, slice_height_m
from gslcosim_services.sensing.models.range_finders import ray_directions_body

# What they are called in the file: another component of the curve's entity, so that both share their times.
NUMBERS_COMPONENT = "numbers"


def encode_numbers(numbers: "array[float]", lengths: Sequence[int]) -> Any:
    """Return rows of so many numbers each in single precision, little-endian, as bytes: a `pyarrow` array."""
    encoded = np.array(numbers, dtype="<f4")
    ends = np.concatenate([[0], encoded.itemsize * np.cumsum(lengths)]).astype(np.int32)
    return pa.Array.from_buffers(pa.binary(), len(lengths), [None, pa.py_buffer(ends), pa.py_buffer(encoded)])


def decode_numbers(rows: Sequence[bytes]) -> NDArray[np.float64]:
    """Return the (n, k) numbers of rows of bytes."""
    return np.frombuffer(b"".join(rows), dtype="<f4").astype(np.float64).reshape(len(rows), -1)


class CurveWithHiddenColumns:
    """Curve of one number a row, and beside it hidden columns as bytes: the viewer would draw numbers, of any name."""

    def __init__(self, entity: str) -> None:
        self._entity = entity
        self._ticks: list[int] = []
        self._drawn = array("d")
        self._numbers = array("f")
        self._lengths: list[int] = []

    def extend(self, ticks: Sequence[int], drawn: Sequence[float], numbers: Sequence[Sequence[float]]) -> None:
        """Append what is drawn at ticks, and what is not."""
        self._ticks += ticks
        self._drawn.extend(drawn)
        self._numbers.extend(chain.from_iterable(numbers))
        self._lengths += map(len, numbers)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if self._ticks:
            rows: Any = {NUMBERS_COMPONENT: encode_numbers(self._numbers, self._lengths)}
            file.send(self._entity, self._ticks, [*scalar_columns(self._drawn), *rr.AnyValues.columns(**rows)])
            self._ticks, self._lengths = [], []
            self._drawn, self._numbers = array("d"), array("f")


class AnemometerRows:
    """The speed that an anemometer reports as a curve, and beside it all that it reports."""

    def __init__(self, entity: str) -> None:
        self._rows = CurveWithHiddenColumns(entity)

    def extend(self, ticks: Sequence[int], readings: Sequence[Reading]) -> None:
        """Append readings that mean something, at the ends of their ticks."""
        speeds_m_s = [speed for reading in readings for speed in wind_speed_m_s(reading)]
        self._rows.extend(ticks, speeds_m_s, [reading.values for reading in readings])

    def send(self, file: RecordingFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        self._rows.send(file)


class BeliefPictureRows:
    """A belief as a picture at its height: brightest in the most probable cell, by the square root of the probability.

    A belief in space is drawn as its sum over the height.
    """

    def __init__(self, entity: str, height_m: float) -> None:
        self._entity = entity
        self._height_m = height_m
        self._colors = colors.belief_colors()
        self._ticks: list[int] = []
        self._beliefs: list[Belief] = []

    def add(self, tick: int, belief: Belief) -> None:
        """Append a belief at a tick."""
        self._ticks.append(tick)
        self._beliefs.append(belief)

    def send(self, file: RecordingFile) -> None:
        """Write the waiting beliefs, if any, and forget them."""
        for tick, belief in zip(self._ticks, self._beliefs, strict=True):
            p = sum_over_height(belief)
            file.send(
                self._entity,
                [tick],
                rr.GridMap.columns(
                    data=[self._picture(p)],
                    format=[picture_format(*p.shape)],
                    cell_size=[belief.cell_m],
                    translation=[(*belief.origin_m[:2], slice_height_m(self._height_m))],
                ),
            )
        self._ticks, self._beliefs = [], []

    # Rows of a picture run from the far side (largest y) to the near one.
    def _picture(self, p: NDArray[np.float64]) -> bytes:
        levels = (np.sqrt(p / p.max()) * (colors.N_LEVELS - 1)).astype(np.uint8)
        return self._colors[levels.T[::-1]].tobytes()


class BeliefRows:
    """Rows of one agent's beliefs: pictures, and curves of their score."""

    def __init__(self, names: AgentEntities) -> None:
        self._names = names
        self.picture = BeliefPictureRows(names.belief, names.agent.vehicle.search_height_m)
        self.mass_near = ScalarRows(names.belief_mass)
        self.expected_distance = ScalarRows(names.belief_distance)
        self.has_any = False
        self._last: BeliefScore | None = None

    def all(self) -> tuple[BeliefPictureRows, ScalarRows, ScalarRows]:
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
        styles = {names.belief_mass: "belief near the source", names.belief_distance: "expected by belief"}
        for entity, text in styles.items():
            shade = colors.plan_color(names.color)
            file.draw(entity, rr.SeriesLines(names=[f"{label}{text}"], colors=[shade], widths=[1.5]))


def sum_over_height(belief: Belief) -> NDArray[np.float64]:
    """Return the (nx, ny) probabilities of a belief, summed over the height where it is in space."""
    p = belief.probability.to_array().astype(np.float64)
    return p.sum(axis=2) if p.ndim == 3 else p


# The first number of a reading is what a gas sensor reports.
_DEFAULT_CURVES = Curves(quantity="response", unit="", labels=("response",))
SpaceRows = LidarRows | RayRows | ImageRows


class AgentRows:
    """All rows of one agent. `gases` are those of the run, `tick_ns` is its tick."""

    def __init__(self, names: AgentEntities, gases: tuple[str, ...], tick_ns: int) -> None:
        self.names = names
        self._tick_ns = tick_ns
        self._poses = PoseHistory(names.agent.sensors, tick_ns)
        self.pose = PoseRows(names.vehicle)
        self.track = TrackRows(names.track)
        self.plan = PlanRows(names.plan)
        self.waypoints = MarkerRows(names.waypoints, radius_m=WAYPOINT_RADIUS_M)
        self.markers = MarkerRows(names.markers, radius_m=MARKER_RADIUS_M)
        self.distance = ScalarRows(names.distance)
        self.tracking_error = ScalarRows(names.tracking_error)
        self.decision = ScalarRows(names.decision)
        self.belief = BeliefRows(names)
        self.position_m: Vec3 = names.agent.vehicle.start_m
        self._mission: tuple[Waypoint, ...] | None = None
        self._gas = {
            (sensor.name, gas): ScalarRows(names.gas(sensor.name, gas)) for sensor in names.gas_sensors for gas in gases
        }
        self._true_wind = {
            sensor.name: CurveWithHiddenColumns(names.true_wind(sensor.name)) for sensor in names.wind_sensors
        }
        lasers = [sensor for sensor in names.gas_sensors if isinstance(sensor, TdlasSensorSpec)]
        self._beams = {sensor.name: self._beam_rows(sensor) for sensor in lasers}
        self._in_space = {
            sensor.name: rows for sensor, _ in names.on_board_sensors if (rows := self._space_rows(sensor))
        }
        self._readings = self._reading_rows()
        self.shows_space = bool(self._in_space or self._beams)

    def all(self) -> list[Rows]:
        """Return the rows of every entity."""
        own = (self.pose, self.track, self.plan, self.waypoints, self.markers, self.distance, self.tracking_error)
        own = (*own, self.decision)
        own = (*own, *self.belief.all())
        truth = (*self._gas.values(), *self._true_wind.values(), *self._beams.values())
        readings = (rows for all_rows in self._readings.values() for rows in all_rows)
        return [*own, *truth, *readings, *self._in_space.values()]

    def draw(self, file: RecordingFile, *, label: str) -> None:
        """Draw the vehicle and say how lines and curves look; `label` precedes the names of curves."""
        names = self.names
        # A name beside the only vehicle would hide what it comes to.
        draw_vehicle(file, names.vehicle, names.agent, names.color, is_named=bool(label))
        file.draw(names.track, rr.LineStrips3D.from_fields(colors=[names.color], radii=[0.035]))
        if names.agent.vehicle.avoidance != "none":
            color = colors.plan_color(names.color)
            file.draw(names.plan, rr.LineStrips3D.from_fields(colors=[color], radii=[0.015]))
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
            tick: At whose end.
            body: The vehicle.
            samples: The truth at the sensors of all vehicles.
            observation: What its sensors report.
        """
        if body is not None:
            self._poses.add(tick, body)
        for sample in samples if self._beams else ():
            if sample.agent == self.names.agent.name and sample.beam_m is not None and sample.sensor in self._beams:
                self._beams[sample.sensor].add_ranges(tick, (sample.beam_m,), tick)
        for reading in observation.readings if observation else ():
            rows = self._in_space.get(reading.sensor)
            if rows is not None:
                rows.add(tick, reading)

    def note_bodies(self, ticks: Sequence[int], bodies: Sequence[BodyState]) -> None:
        """Take note of where the vehicle is at the ends of ticks."""
        positions_m = [body.position_world_m for body in bodies]
        self.pose.extend(ticks, positions_m, [body.quaternion_wxyz for body in bodies])
        self.track.extend(ticks, positions_m)
        self.plan.extend(ticks, positions_m, [body.planned_path_world_m for body in bodies])
        errors_m = [error_m for body in bodies if (error_m := body.tracking_error_m) is not None]
        if len(errors_m) < len(bodies):
            ticks = [tick for tick, body in zip(ticks, bodies, strict=True) if body.tracking_error_m is not None]
        self.tracking_error.extend(ticks, errors_m)

    def note_samples(self, sensor: str, ticks: Sequence[int], samples: Sequence[MountSample]) -> None:
        """Take note of the truth at a sensor at the ends of ticks."""
        rows = self._true_wind.get(sensor)
        if rows is not None:
            winds_m_s = [sample.wind_world_m_s for sample in samples]
            rows.extend(ticks, [math.sqrt(u * u + v * v + w * w) for u, v, w in winds_m_s], winds_m_s)
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
        for rows in all_rows:
            rows.extend(ticks, readings)

    def note_scores(self, ticks: Sequence[int], standings: Sequence[AgentScore]) -> None:
        """Take note of the referee's scores of it at the ends of ticks."""
        self.distance.extend(ticks, [standing.distance_to_source_m for standing in standings])
        for tick, standing in zip(ticks, standings, strict=True):
            if standing.belief is not None:
                self.belief.note_score(tick, standing.belief)

    def note_command(self, tick: int, command: Command) -> None:
        """Take note of where the vehicle is sent, of declarations and beliefs."""
        if command.belief is not None:
            self.belief.note_belief(tick, command.belief)
        if command.kind == "waypoint" and command.position_world_m is not None:
            self.waypoints.add(tick, command.position_world_m, "", self.names.color)
        elif command.kind == "mission" and command.waypoints != self._mission:
            self._mission = command.waypoints
            for point in command.waypoints or ():
                self.waypoints.add(tick, point.position_world_m, "", self.names.color)
        elif command.kind == "declare_source" and command.declaration is not None:
            self.markers.add(tick, command.declaration.position_world_m, "declared", self.names.color)

    def _reading_rows(self) -> Mapping[str, tuple[ReadingRows, ...]]:
        names = self.names
        rows: dict[str, tuple[ReadingRows, ...]] = {}
        for sensor in names.gas_sensors:
            rows[sensor.name] = (CurveRows(names.response(sensor.name), _DEFAULT_CURVES.values_of),)
        for sensor in names.wind_sensors:
            rows[sensor.name] = (AnemometerRows(names.measured_wind(sensor.name)),)
        for sensor, curves in names.on_board_sensors:
            rows[sensor.name] = tuple(CurveRows(names.on_board(sensor.name, item), item.values_of) for item in curves)
        return rows

    # Names and colours of each entity's curves.
    def _styles(self, label: str) -> dict[str, list[tuple[str, colors.Rgb]]]:
        names = self.names
        styles = {
            names.distance: [(label.strip() or "distance", names.color)],
            names.tracking_error: [(label.strip() or "error", names.color)],
            names.decision: [(label.strip() or "decision", names.color)],
        }
        n_gases = len({gas for _, gas in self._gas})
        for i, (sensor, gas) in enumerate(self._gas):
            of_gas = f" {gas}" if n_gases > 1 else ""
            styles[names.gas(sensor, gas)] = [(f"{label}{sensor}{of_gas}", colors.shade(names.color, i))]
        for i, sensor in enumerate(names.gas_sensors):
            styles[names.response(sensor.name)] = [(f"{label}{sensor.name}", colors.shade(names.color, i))]
        for i, sensor in enumerate(names.wind_sensors):
            of_sensor = f"{sensor.name} " if len(names.wind_sensors) > 1 else ""
            measured = colors.shade(names.color if label else colors.WIND, i)
            styles[names.measured_wind(sensor.name)] = [(f"{label}{of_sensor}measured", measured)]
            styles[names.true_wind(sensor.name)] = [(f"{label}{of_sensor}true", colors.TRUTH)]
        for sensor, curves in names.on_board_sensors:
            for item in curves:
                if item.labels:
                    drawn = list(zip(item.labels, item.colors, strict=True))
                    styles[names.on_board(sensor.name, item)] = drawn
        return styles

    def _space_rows(self, sensor: SensorSpec) -> SpaceRows | None:
        entity, timing, color = self.names.seen(sensor.name), RowTiming(sensor, self._tick_ns), self.names.color
        if isinstance(sensor, LidarSensorSpec):
            return LidarRows(entity, sensor, self._poses, timing, color)
        if isinstance(sensor, RaySensorSpec):
            return RayRows(entity, sensor, self._poses, timing, ray_directions_body(sensor), color)
        if isinstance(sensor, CameraSensorSpec):
            return ImageRows(entity, sensor, self._poses, color)
        return None

    def _beam_rows(self, sensor: TdlasSensorSpec) -> RayRows:
        direction = np.array([sensor.beam_body]) / np.linalg.norm(sensor.beam_body)
        entity, timing = self.names.seen(sensor.name), RowTiming(sensor, self._tick_ns)
        return RayRows(entity, sensor, self._poses, timing, direction, self.names.color)
