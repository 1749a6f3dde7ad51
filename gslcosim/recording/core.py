"""The recorder as a participant: reads everything, writes one Rerun file."""

import math
from pathlib import Path
from typing import cast

import rerun as rr

from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    Command,
    FieldSamples,
    FilamentCloud,
    Observation,
    RadioTraffic,
    RadioTransmission,
    Score,
    Vec3,
    Verdict,
    Waypoint,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec
from gslcosim.environment.model import Environment
from gslcosim.recording import colors, entities
from gslcosim.recording.blueprint import default_blueprint
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import AgentEntities, entities_of
from gslcosim.recording.onboard_rows import ImageRows, LidarRows
from gslcosim.recording.ports import recorder_spec
from gslcosim.recording.rows import (
    MARKER_RADIUS_M,
    WAYPOINT_RADIUS_M,
    FilamentRows,
    MarkerRows,
    PlanRows,
    PoseRows,
    Rows,
    ScalarRows,
    SliceRows,
    TextRows,
    TrackRows,
)
from gslcosim.recording.run_file import RunFile
from gslcosim.recording.scene import draw_map, draw_room, draw_sources
from gslcosim.recording.summary import summary_text, title
from gslcosim.recording.vehicle_shapes import draw_vehicle
from gslcosim.recording.wind_layer import WindLayer, WindRows
from gslcosim.scenario import Scenario
from gslcosim.scenario.models import SensorSpec
from gslcosim.ticks import seconds_from_ticks

# Rows are sent together: a call costs some 100 us, whether it carries one row or many.
FLUSH_TICKS = 128
# What of the referee's events is marked in the room where it happened; all of them are in its log.
MARKED_EVENTS = {"take_off": "start", "gas_contact": "first gas", "contact": "contact"}
WARNING_EVENTS = frozenset({"contact", "refused", "collision", "agent_failed", "out_of_bounds"})


class AgentRows:
    """All rows of one agent."""

    def __init__(self, names: AgentEntities) -> None:
        self.names = names
        self.pose = PoseRows(names.vehicle)
        self.track = TrackRows(names.track)
        self.plan = PlanRows(names.plan)
        self.waypoints = MarkerRows(names.waypoints, radius_m=WAYPOINT_RADIUS_M)
        self.markers = MarkerRows(names.markers, radius_m=MARKER_RADIUS_M)
        self.distance = ScalarRows(names.distance)
        self.tracking_error = ScalarRows(names.tracking_error)
        self.mission: tuple[Waypoint, ...] | None = None
        self.gas: dict[tuple[str, str], ScalarRows] = {}
        self.response = {sensor: ScalarRows(names.response(sensor)) for sensor in names.gas_sensors}
        self.true_wind = {sensor: ScalarRows(names.true_wind(sensor)) for sensor in names.wind_sensors}
        self.measured_wind = {sensor: ScalarRows(names.measured_wind(sensor)) for sensor in names.wind_sensors}
        self.seen: dict[str, LidarRows | ImageRows] = {
            sensor.name: _seen_rows(names, sensor)
            for sensor in names.agent.sensors
            if sensor.model in entities.LIDAR_MODELS | entities.CAMERA_MODELS
        }
        self.position_m: Vec3 = names.agent.vehicle.start_m

    def all(self) -> list[Rows]:
        """Return the rows of every entity."""
        curves = (self.gas, self.response, self.true_wind, self.measured_wind)
        return [
            self.pose,
            self.track,
            self.plan,
            self.waypoints,
            self.markers,
            self.distance,
            self.tracking_error,
            *self.seen.values(),
            *(rows for group in curves for rows in group.values()),
        ]


def _seen_rows(names: AgentEntities, sensor: SensorSpec) -> LidarRows | ImageRows:
    if sensor.model in entities.LIDAR_MODELS:
        return LidarRows(names.on_board(sensor.name), sensor, names.color)
    return ImageRows(names.on_board(sensor.name))


class RecorderCore:
    """Writes a run into one .rrd file that opens with a layout of its own.

    Reads every port of the run with delay 0, writes none. Draws nothing random and reads no clock, so equal runs give
    equal content. What comes after the verdict is not recorded. The file exists from `reset` on and is whole when
    `close` has returned. Steps only append; every `FLUSH_TICKS` ticks the rows are sent to the file.

    Raises RecordingError when the file cannot be written; the runtime then stops the run.
    """

    def __init__(self, scenario: Scenario, environment: Environment, path: Path, *, run_id: str | None = None) -> None:
        """Prepare a recording.

        Args:
            scenario: What is flown.
            environment: Where.
            path: The file to write; an existing one is replaced at `reset`.
            run_id: The recording's identity in the viewer; by default the name of the file's folder.
        """
        self._scenario = scenario
        self._environment = environment
        self._path = path
        self._run_id = run_id or path.resolve().parent.name
        self._spec = recorder_spec(scenario)
        self._wind_layer = WindLayer(environment, scenario.slice_height_m)
        self._file: RunFile | None = None
        self._begin()

    @property
    def spec(self) -> ParticipantSpec:
        """Return the declared reads and writes."""
        return self._spec

    def reset(self, episode: Episode) -> Outbox:
        """Open the file and draw what stands still."""
        del episode
        self.close()
        self._begin()
        self._file = RunFile(
            self._path,
            run_id=self._run_id,
            name=title(self._scenario),
            tick_ns=self._scenario.tick_ns,
            blueprint=default_blueprint(self._scenario, self._environment),
        )
        self._draw_scene(self._file)
        # Rows overtake what stands still, which waits some time in Rerun: a file cut off early would lack the room.
        self._file.flush()
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Take note of everything of this tick."""
        if self._is_over:
            return {}
        self._wind.add(tick, self._scenario.gas.warm_up_s + seconds_from_ticks(tick, self._scenario.tick_ns))
        self._note_truth(tick, inbox)
        self._note_agents(tick, inbox)
        self._note_radio(tick, cast(RadioTraffic | None, inbox.get(keys.RADIO)))
        self._note_score(tick, cast(Score | None, inbox.get(keys.SCORE)))
        verdict = cast(Verdict | None, inbox.get(keys.VERDICT))
        if verdict is not None:
            self._end(verdict)
        elif tick % FLUSH_TICKS == FLUSH_TICKS - 1:
            self._send_all()
        return {}

    def close(self) -> None:
        """Send what waits, write the file's footer and release it; without an open file, do nothing."""
        if self._file is None:
            return
        file = self._file
        for agent in self._agents.values():
            agent.track.end_strip()
        self._send_all()
        self._file = None
        file.close()

    def _begin(self) -> None:
        self._is_over = False
        self._agents = {names.agent.name: AgentRows(names) for names in entities_of(self._scenario)}
        self._filaments = FilamentRows(entities.FILAMENTS, self._scenario)
        self._slices: dict[str, SliceRows] = {}
        self._wind = WindRows(entities.WIND, self._wind_layer)
        self._events = TextRows(entities.EVENTS)
        self._radio = TextRows(entities.RADIO)
        self._observations = [(agent, keys.observation(name)) for name, agent in self._agents.items()]
        self._commands = [(agent, keys.command(name)) for name, agent in self._agents.items()]

    def _draw_scene(self, file: RunFile) -> None:
        scenario, environment = self._scenario, self._environment
        draw_room(file, environment)
        draw_sources(file, scenario)
        draw_map(file, environment, GasScale.of(scenario), scenario.slice_height_m)
        self._wind_layer.draw(file, entities.WIND)
        for agent in self._agents.values():
            names = agent.names
            draw_vehicle(file, names.vehicle, names.agent, names.color)
            file.draw(names.track, rr.LineStrips3D.from_fields(colors=[names.color], radii=[0.035]))
            if names.agent.vehicle.avoidance != "none":
                color = colors.plan_color(names.color)
                file.draw(names.plan, rr.LineStrips3D.from_fields(colors=[color], radii=[0.015]))
            self._style_curves(file, names)
        self._write_summary(file, tick=0, verdict=None)

    def _style_curves(self, file: RunFile, names: AgentEntities) -> None:
        is_alone = len(self._agents) == 1
        prefix = "" if is_alone else f"{names.agent.name} "
        styles = [
            (names.distance, f"{prefix}distance", names.color),
            (names.tracking_error, f"{prefix}tracking error", names.color),
        ]
        for sensor in names.gas_sensors:
            styles.append((names.gas(sensor, self._scenario.gas.gas), f"{prefix}{sensor}", names.color))
            styles.append((names.response(sensor), f"{prefix}{sensor}", names.color))
        for sensor in names.wind_sensors:
            styles.append((names.measured_wind(sensor), f"{prefix}measured", colors.WIND if is_alone else names.color))
            styles.append((names.true_wind(sensor), f"{prefix}true", colors.READING))
        for entity, label, color in styles:
            file.draw(entity, rr.SeriesLines(names=[label], colors=[color], widths=[1.5]))

    def _note_truth(self, tick: int, inbox: Inbox) -> None:
        bodies = cast(BodyPoses | None, inbox.get(keys.BODIES))
        if bodies is not None:
            for body in bodies.bodies:
                agent = self._agents[body.agent]
                agent.position_m = body.position_world_m
                agent.pose.add(tick, body.position_world_m, body.quaternion_wxyz)
                agent.track.add(tick, body.position_world_m)
                agent.plan.add(tick, body.position_world_m, body.planned_path_world_m)
                if body.tracking_error_m is not None:
                    agent.tracking_error.add(tick, body.tracking_error_m)
        samples = cast(FieldSamples | None, inbox.get(keys.SAMPLES))
        if samples is not None:
            self._note_samples(tick, samples)
        cloud = cast(FilamentCloud | None, inbox.get(keys.FILAMENTS))
        if cloud is not None:
            self._filaments.add(tick, cloud)
            for item in cloud.slices:
                self._slice_rows(item.gas).add(tick, item)

    def _note_samples(self, tick: int, samples: FieldSamples) -> None:
        for sample in samples.samples:
            agent = self._agents[sample.agent]
            wind = agent.true_wind.get(sample.sensor)
            if wind is not None:
                u, v, w = sample.wind_world_m_s
                wind.add(tick, math.sqrt(u * u + v * v + w * w))
                continue
            for gas in sample.gases:
                rows = agent.gas.get((sample.sensor, gas.gas))
                if rows is None:
                    rows = ScalarRows(agent.names.gas(sample.sensor, gas.gas))
                    agent.gas[sample.sensor, gas.gas] = rows
                rows.add(tick, gas.mixing_ratio_ppm)

    def _note_agents(self, tick: int, inbox: Inbox) -> None:
        for agent, port in self._observations:
            observation = cast(Observation | None, inbox.get(port))
            if observation is None:
                continue
            for reading in observation.readings:
                if reading.sensor in agent.seen:
                    agent.seen[reading.sensor].add(tick, reading)
                rows = agent.response.get(reading.sensor) or agent.measured_wind.get(reading.sensor)
                if rows is not None and reading.values:
                    rows.add(tick, reading.values[0])
        for agent, port in self._commands:
            command = cast(Command | None, inbox.get(port))
            if command is not None:
                self._note_command(tick, agent, command)

    def _note_command(self, tick: int, agent: AgentRows, command: Command) -> None:
        if command.kind == "waypoint" and command.position_world_m is not None:
            agent.waypoints.add(tick, command.position_world_m, "", agent.names.color)
        elif command.kind == "mission" and command.waypoints != agent.mission:
            agent.mission = command.waypoints
            for point in command.waypoints or ():
                agent.waypoints.add(tick, point.position_world_m, "", agent.names.color)
        elif command.kind == "declare_source" and command.declaration is not None:
            agent.markers.add(tick, command.declaration.position_world_m, "declared", agent.names.color)

    def _note_radio(self, tick: int, traffic: RadioTraffic | None) -> None:
        for sent in traffic.transmissions if traffic else ():
            self._radio.add(tick, radio_text(sent), "WARN" if sent.refusal else "INFO")

    def _note_score(self, tick: int, score: Score | None) -> None:
        if score is None:
            return
        for standing in score.agents:
            self._agents[standing.agent].distance.add(tick, standing.distance_to_source_m)
        for event in score.events:
            level = "WARN" if event.kind in WARNING_EVENTS else "INFO"
            agent = self._agents.get(event.agent) if event.agent is not None else None
            self._events.add(tick, f"{event.agent}: {event.text}" if agent else event.text, level)
            label = MARKED_EVENTS.get(event.kind)
            if agent is not None and label is not None:
                agent.markers.add(tick, agent.position_m, label, agent.names.color)

    def _slice_rows(self, gas: str) -> SliceRows:
        if gas not in self._slices:
            self._slices[gas] = SliceRows(f"{entities.SLICES}/{gas}", GasScale.of(self._scenario))
        return self._slices[gas]

    def _end(self, verdict: Verdict) -> None:
        self._is_over = True
        time_s = seconds_from_ticks(verdict.tick, self._scenario.tick_ns)
        self._events.add(
            verdict.tick, f"the run ends after {time_s:g} s: {verdict.end_reason.replace('_', ' ')}", "INFO"
        )
        for agent in self._agents.values():
            agent.track.end_strip()
        self._send_all()
        if self._file is not None:
            self._write_summary(self._file, tick=verdict.tick, verdict=verdict)
            self._file.flush()

    def _write_summary(self, file: RunFile, *, tick: int, verdict: Verdict | None) -> None:
        text = summary_text(self._scenario, self._environment, verdict)
        columns = rr.TextDocument.columns(text=[text], media_type=[rr.components.MediaType.MARKDOWN])
        file.send(entities.SUMMARY, [tick], columns)

    def _send_all(self) -> None:
        if self._file is None:
            return
        rows: list[Rows] = [self._filaments, self._wind, self._events, self._radio, *self._slices.values()]
        for agent in self._agents.values():
            rows += agent.all()
        for item in rows:
            item.send(self._file)


def radio_text(sent: RadioTransmission) -> str:
    """Return in one line what was sent and what became of it."""
    head = f"{sent.sender} on {sent.message.channel} to {sent.message.to}: {sent.message.text}"
    if sent.refusal is not None:
        return f"{head}   [refused: {sent.refusal}]"
    fates = {"heard by": sent.reached, "lost for": sent.lost, "out of range of": sent.out_of_range}
    told = "; ".join(f"{words} {', '.join(names)}" for words, names in fates.items() if names)
    return f"{head}   [{told}]"
