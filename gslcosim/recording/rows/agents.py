"""All rows of one agent: its vehicle, where it goes and was sent, and what its sensors report."""

import math
from collections import defaultdict
from collections.abc import Mapping

import numpy as np
import rerun as rr

from gslcosim.contract.messages import AgentScore, BodyState, Command, MountSample, Observation, Reading, Waypoint
from gslcosim.quantities import Vec3
from gslcosim.recording import colors
from gslcosim.recording.entities import AgentEntities
from gslcosim.recording.instruments import Curves
from gslcosim.recording.rows.beliefs import BeliefRows
from gslcosim.recording.rows.columns import (
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
)
from gslcosim.recording.rows.onboard import ImageRows, LidarRows, Poses, RayRows, RowTiming
from gslcosim.recording.rows.undrawn import AnemometerRows, CurveWithNumbers
from gslcosim.recording.run_file import RunFile
from gslcosim.recording.vehicle_shapes import draw_vehicle
from gslcosim.scenario.models.gas_sensors import TdlasSensorSpec
from gslcosim.scenario.models.onboard import CameraSensorSpec, LidarSensorSpec
from gslcosim.scenario.models.sensor_base import RaySensorSpec, SensorSpec
from gslcosim.sensing.models.ranging import directions_body

# The first number of a reading is what a gas sensor reports.
_FIRST = Curves(quantity="response", unit="", labels=("response",))
SpaceRows = LidarRows | RayRows | ImageRows


class AgentRows:
    """All rows of one agent. `gases` are those of the run, `tick_ns` is its tick."""

    def __init__(self, names: AgentEntities, gases: tuple[str, ...], tick_ns: int) -> None:
        self.names = names
        self._tick_ns = tick_ns
        self._poses = Poses(names.agent.sensors, tick_ns)
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
        self._true_wind = {sensor.name: CurveWithNumbers(names.true_wind(sensor.name)) for sensor in names.wind_sensors}
        lasers = [sensor for sensor in names.gas_sensors if isinstance(sensor, TdlasSensorSpec)]
        self._beams = {sensor.name: self._beam_rows(sensor) for sensor in lasers}
        self._in_space = {
            sensor.name: rows for sensor, _ in names.on_board_sensors if (rows := self._space_rows(sensor))
        }
        self._readings = self._reading_rows()
        # Curves are made of many readings at once, other rows of each when it comes, when the pose is still known.
        self._curves = {
            sensor: [rows for rows in sinks if isinstance(rows, CurveRows)] for sensor, sinks in self._readings.items()
        }
        self._one_by_one = {
            sensor: others
            for sensor, sinks in self._readings.items()
            if (others := [rows for rows in sinks if not isinstance(rows, CurveRows)])
        }
        self._has_poses = bool(self._in_space or self._beams)
        # What was noted since rows were made of it, with its ticks.
        self._bodies: list[tuple[int, BodyState]] = []
        self._amounts: dict[tuple[str, str], list[tuple[int, float]]] = {place: [] for place in self._gas}
        self._reported: dict[str, list[tuple[int, Reading]]] = defaultdict(list)
        self._distances: list[tuple[int, float]] = []

    def all(self) -> list[Rows]:
        """Return the rows of every entity."""
        own = (self.pose, self.track, self.plan, self.waypoints, self.markers, self.distance, self.tracking_error)
        own = (*own, self.decision)
        own = (*own, *self.belief.all())
        truth = (*self._gas.values(), *self._true_wind.values(), *self._beams.values())
        return [*own, *truth, *(rows for sinks in self._readings.values() for rows in sinks)]

    def draw(self, file: RunFile, *, label: str) -> None:
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

    def note_body(self, tick: int, body: BodyState) -> None:
        """Take note of where the vehicle is."""
        self.position_m = body.position_world_m
        self._bodies.append((tick, body))
        if self._has_poses:
            self._poses.add(tick, body)

    def note_sample(self, tick: int, sample: MountSample) -> None:
        """Take note of the truth at a sensor."""
        wind = self._true_wind.get(sample.sensor)
        if wind is not None:
            u, v, w = sample.wind_world_m_s
            wind.add(tick, math.sqrt(u * u + v * v + w * w), sample.wind_world_m_s)
            return
        for gas in sample.gases:
            amounts = self._amounts.get((sample.sensor, gas.gas))
            if amounts is not None:
                amounts.append((tick, gas.mixing_ratio_ppm))
        if sample.beam_m is not None and sample.sensor in self._beams:
            self._beams[sample.sensor].add_ranges(tick, (sample.beam_m,), tick)

    def note_observation(self, tick: int, observation: Observation) -> None:
        """Take note of what the sensors report."""
        for reading in observation.readings:
            self._reported[reading.sensor].append((tick, reading))
            for rows in self._one_by_one.get(reading.sensor, ()):
                rows.add(tick, reading)

    def note_standing(self, tick: int, standing: AgentScore) -> None:
        """Take note of what the referee says of it."""
        self._distances.append((tick, standing.distance_to_source_m))
        if standing.belief is not None:
            self.belief.note_score(tick, standing.belief)

    def take(self) -> None:
        """Make rows of what was noted since the last call, column by column."""
        self._take_bodies()
        self.distance.extend(self._distances)
        self._distances.clear()
        for place, amounts in self._amounts.items():
            self._gas[place].extend(amounts)
            amounts.clear()
        for sensor, reported in self._reported.items():
            curves = self._curves.get(sensor, ())
            meaningful = [noted for noted in reported if not noted[1].is_warming_up] if curves else []
            for rows in curves:
                rows.extend(meaningful)
            reported.clear()

    def _take_bodies(self) -> None:
        noted, self._bodies = self._bodies, []
        if not noted:
            return
        ticks, bodies = zip(*noted, strict=True)
        positions_m = [body.position_world_m for body in bodies]
        self.pose.extend(ticks, positions_m, [body.quaternion_wxyz for body in bodies])
        self.track.extend(ticks, positions_m)
        self.tracking_error.extend(
            [(tick, body.tracking_error_m) for tick, body in noted if body.tracking_error_m is not None]
        )
        for tick, body in noted:
            self.plan.add(tick, body.position_world_m, body.planned_path_world_m)

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
            rows[sensor.name] = (CurveRows(names.response(sensor.name), _FIRST.values_of),)
        for sensor in names.wind_sensors:
            rows[sensor.name] = (AnemometerRows(names.measured_wind(sensor.name)),)
        for sensor, curves in names.on_board_sensors:
            in_space = self._in_space.get(sensor.name)
            drawn = [CurveRows(names.on_board(sensor.name, item), item.values_of) for item in curves]
            rows[sensor.name] = (*drawn, in_space) if in_space else tuple(drawn)
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
            return RayRows(entity, sensor, self._poses, timing, directions_body(sensor), color)
        if isinstance(sensor, CameraSensorSpec):
            return ImageRows(entity, sensor, self._poses, color)
        return None

    def _beam_rows(self, sensor: TdlasSensorSpec) -> RayRows:
        direction = np.array([sensor.beam_body]) / np.linalg.norm(sensor.beam_body)
        entity, timing = self.names.seen(sensor.name), RowTiming(sensor, self._tick_ns)
        return RayRows(entity, sensor, self._poses, timing, direction, self.names.color)
