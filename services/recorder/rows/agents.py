"""Rows of one agent: its vehicle, waypoints, sensor readings and score, beliefs and notes."""

import math
from collections.abc import Callable, Iterable, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
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
from gslcosim.scenario.models.sensors import CameraSensorSpec, RaySensorSpec, TdlasSensorSpec
from gslcosim_services.recorder import colors
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.entities import AgentEntities
from gslcosim_services.recorder.rows.archetypes import Marker, Picture
from gslcosim_services.recorder.rows.columns import RecordingRows, Rows, split_columns
from gslcosim_services.recorder.rows.onboard_sensors import ImageRows, PoseHistory, RangeRows
from gslcosim_services.recorder.scene import slice_height_m
from gslcosim_services.recorder.stream_table import Stream, split_values

# A track grows by a strip of this many ticks; the viewer draws as many strips as have passed.
TRACK_STRIP_TICKS = 10


class TrackRows:
    """The line a vehicle leaves behind, in strips of `TRACK_STRIP_TICKS`: the viewer shows all up to its cursor."""

    def __init__(self, rows: Rows) -> None:
        self._rows = rows
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
        """End the open strip here; the next one starts at its end."""
        if len(self._open_strip_m) > 1:
            self._rows.add(self._last_tick, self._open_strip_m)
            self._open_strip_m = self._open_strip_m[-1:]


class AgentRows:
    """All rows of one agent. `gases` are those of the run, `tick_ns` is its tick."""

    def __init__(self, rows: RecordingRows, names: AgentEntities, gases: tuple[str, ...], tick_ns: int) -> None:
        self.names = names
        self.position_m: Vec3 = names.agent.vehicle.start_m
        self.has_beliefs = self.has_notes = False
        self._rows = rows
        self._gases = frozenset(gases)
        self._gas_sensors = frozenset(sensor.name for sensor in names.gas_sensors)
        self._wind_sensors = frozenset(sensor.name for sensor in names.wind_sensors)
        self._parts = self._split_readings()
        self.track = TrackRows(self.of(streams.TRACK_LINE))
        self._planned_path_m: tuple[Vec3, ...] = ()
        self._mission: tuple[Waypoint, ...] | None = None
        self._belief_score: BeliefScore | None = None
        self._mode = ""
        self._belief_colors = colors.belief_colors()
        self._poses = PoseHistory(names.agent.sensors, tick_ns)
        self._beams = {
            sensor.name: RangeRows(rows, names, sensor, self._poses, tick_ns)
            for sensor in names.gas_sensors
            if isinstance(sensor, TdlasSensorSpec)
        }
        self._in_space: dict[str, RangeRows | ImageRows] = {}
        for sensor, _ in names.on_board_sensors:
            if isinstance(sensor, RaySensorSpec):
                self._in_space[sensor.name] = RangeRows(rows, names, sensor, self._poses, tick_ns)
            elif isinstance(sensor, CameraSensorSpec):
                self._in_space[sensor.name] = ImageRows(rows, names, sensor, self._poses)
        self.shows_space = bool(self._in_space or self._beams)

    def of(self, stream: Stream, **names: str) -> Rows:
        """Return the rows of one of the agent's streams."""
        return self._rows.of(stream, agent=self.names.agent.name, **names)

    def mark(self, tick: int, position_world_m: Vec3, label: str, *, is_shown: bool = True) -> None:
        """Mark an event at a place, in the agent's colour."""
        self.of(streams.MARKS).add(tick, Marker(position_world_m, label, self.names.color, is_shown))

    def note_space(
        self, tick: int, body: BodyState | None, samples: Iterable[MountSample], observation: Observation | None
    ) -> None:
        """Append the surroundings that sensors measure, while the pose of the measurement is still held.

        Args:
            samples: The truth at the sensors of all vehicles.
        """
        if body is not None:
            self._poses.add(tick, body)
        for sample in samples if self._beams else ():
            if sample.agent == self.names.agent.name and sample.beam_m is not None and sample.sensor in self._beams:
                self._beams[sample.sensor].add_rays(tick, (sample.beam_m,), tick)
        for reading in observation.readings if observation else ():
            sensor = self._in_space.get(reading.sensor)
            if sensor is not None:
                sensor.add_reading(tick, reading)

    def note_bodies(self, ticks: Sequence[int], bodies: Sequence[BodyState]) -> None:
        """Append the vehicle's states at the ends of ticks; a planned path only if it is not the rest of the last."""
        positions_m = [body.position_world_m for body in bodies]
        self.of(streams.TRACK).extend(ticks, [(body.position_world_m, body.quaternion_wxyz) for body in bodies])
        self.track.extend(ticks, positions_m)
        paths_m = [body.planned_path_world_m for body in bodies]
        if self._planned_path_m or any(paths_m):
            for tick, position_m, path_m in zip(ticks, positions_m, paths_m, strict=True):
                if path_m and self._planned_path_m[-len(path_m) :] != path_m:
                    self.of(streams.PLANNED_PATH).add(tick, (position_m, *path_m))
                self._planned_path_m = path_m
        errors_m = [error_m for body in bodies if (error_m := body.tracking_error_m) is not None]
        if len(errors_m) < len(bodies):
            ticks = [tick for tick, body in zip(ticks, bodies, strict=True) if body.tracking_error_m is not None]
        self.of(streams.TRACKING_ERROR).extend(ticks, errors_m)

    def note_samples(self, sensor: str, ticks: Sequence[int], samples: Sequence[MountSample]) -> None:
        """Append the truth at a sensor at the ends of ticks."""
        if sensor in self._wind_sensors:
            winds_m_s = [sample.wind_world_m_s for sample in samples]
            speeds_m_s = [math.sqrt(u * u + v * v + w * w) for u, v, w in winds_m_s]
            self.of(streams.TRUE_WIND_SPEED, sensor=sensor).extend(ticks, speeds_m_s)
            self.of(streams.TRUE_WIND, sensor=sensor).extend(ticks, winds_m_s)
        elif sensor in self._gas_sensors:
            for gas, (gas_ticks, amounts) in split_columns(ticks, [sample.gases for sample in samples], "gas"):
                if gas in self._gases:
                    rows = self.of(streams.MIXING_RATIO, sensor=sensor, gas=gas)
                    rows.extend(gas_ticks, [amount.mixing_ratio_ppm for amount in amounts])

    def note_readings(self, sensor: str, ticks: Sequence[int], readings: Sequence[Reading]) -> None:
        """Append a sensor's readings at the ends of ticks, but for those while it warms up."""
        parts = self._parts.get(sensor)
        if not parts:
            return
        if any(reading.is_warming_up for reading in readings):
            meaningful = [noted for noted in zip(ticks, readings, strict=True) if not noted[1].is_warming_up]
            ticks, readings = [tick for tick, _ in meaningful], [reading for _, reading in meaningful]
        values = [reading.values for reading in readings]
        for rows, part in parts:
            rows.extend(ticks, map(part, values))

    def note_scores(self, ticks: Sequence[int], standings: Sequence[AgentScore]) -> None:
        """Append the referee's scores at the ends of ticks; that of a belief only if it is new."""
        self.of(streams.DISTANCE).extend(ticks, [standing.distance_to_source_m for standing in standings])
        for tick, standing in zip(ticks, standings, strict=True):
            score = standing.belief
            if score is not None and score != self._belief_score:
                self.of(streams.BELIEF_MASS).add(tick, score.mass_near_frac)
                self.of(streams.BELIEF_DISTANCE).add(tick, score.expected_distance_m)
                self._belief_score = score

    def note_command(self, tick: int, command: Command) -> None:
        """Append a command's waypoints and declaration, its belief and its note."""
        if command.note is not None:
            self._add_note(tick, command.note)
        if command.belief is not None:
            self._add_belief(tick, command.belief)
        if command.kind == "waypoint" and command.position_world_m is not None:
            self._add_waypoint(tick, command.position_world_m)
        elif command.kind == "mission" and command.waypoints != self._mission:
            self._mission = command.waypoints
            for point in command.waypoints or ():
                self._add_waypoint(tick, point.position_world_m)
        elif command.kind == "declare_source" and command.declaration is not None:
            self.mark(tick, command.declaration.position_world_m, "declared")

    def _add_waypoint(self, tick: int, position_world_m: Vec3) -> None:
        self.of(streams.WAYPOINTS).add(tick, Marker(position_world_m, "", self.names.color))

    # Brightest in the most probable cell, by the square root of the probability.
    def _add_belief(self, tick: int, belief: Belief) -> None:
        self.has_beliefs = True
        p = sum_over_height(belief)
        levels = (np.sqrt(p / p.max()) * (colors.N_LEVELS - 1)).astype(np.uint8)
        corner_m = (*belief.origin_m[:2], slice_height_m(self.names.agent.vehicle.search_height_m))
        # Rows of a picture run from the far side (largest y) to the near one.
        self.of(streams.BELIEF).add(tick, Picture(self._belief_colors[levels.T[::-1]], belief.cell_m, corner_m))

    def _add_note(self, tick: int, note: Note) -> None:
        self.has_notes = True
        if note.mode != self._mode:
            self._mode = note.mode
            self.of(streams.NOTE_MODE).add(tick, note.mode)
        for name, value in note.values.items():
            self.of(streams.NOTE_VALUES, value=name).add(tick, value)

    # Rows of each sensor's readings, each with the function that takes their item out of a reading's values.
    def _split_readings(self) -> dict[str, list[tuple[Rows, Callable[[Sequence[float]], Any]]]]:
        parts: dict[str, list[tuple[Rows, Callable[[Sequence[float]], Any]]]] = {}
        for sensor in self.names.gas_sensors:
            # The first number of a reading is the response of a gas sensor.
            parts[sensor.name] = [(self.of(streams.RESPONSE, sensor=sensor.name), itemgetter(slice(1)))]
        for sensor in self.names.wind_sensors:
            speed = self.of(streams.WIND_SPEED, sensor=sensor.name)
            if sensor.name in self.names.bearing_sensors:
                bearing = self.of(streams.WIND_FROM, sensor=sensor.name)
                parts[sensor.name] = [(speed, itemgetter(0)), (bearing, itemgetter(slice(1, None)))]
            else:
                vector = self.of(streams.APPARENT_WIND, sensor=sensor.name)
                parts[sensor.name] = [(speed, lambda vector_m_s: math.hypot(*vector_m_s)), (vector, tuple)]
        for sensor, own in self.names.on_board_sensors:
            parts[sensor.name] = [
                (self.of(stream, sensor=sensor.name), itemgetter(part))
                for stream, part in zip(own, split_values(own), strict=True)
            ]
        return parts


def sum_over_height(belief: Belief) -> NDArray[np.float64]:
    """Return the (nx, ny) probabilities of a belief, summed over the height where it is in space."""
    p = belief.probability.to_array().astype(np.float64)
    return p.sum(axis=2) if p.ndim == 3 else p
