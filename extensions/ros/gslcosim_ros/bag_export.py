"""ROS 2 topics of a run as messages by time, and bag files of them: one MCAP, or a folder of rosbag2."""

import heapq
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.base.frames import rotation_from_rpy, world_from_body_rotation
from gslcosim.scenario.models.sensors import LidarSensorSpec, SensorSpec
from gslcosim_data.export.tables import safe_name
from gslcosim_data.run import RunData
from gslcosim_data.streams import RecordedPictures, RecordedSeries, RecordedShapes, RecordedTrack
from gslcosim_ros.live.messages import (
    BLUE,
    WAYPOINT_M,
    base_frame,
    description_topic,
    find_qos,
    find_reading_type,
    frame_of,
    make_calibration,
    make_description,
    make_filaments,
    make_gas,
    make_map,
    make_marker,
    make_mounts,
    make_odometry,
    make_picture,
    make_reading,
    make_scan,
    make_sources,
    make_true_wind,
    picture_topic,
    scan_angles,
    topic_of,
)
from gslcosim_ros.types import MAP_FRAME, REMEDY, RosTypes, Vector, ros_types
from gslcosim_services.recorder.stream_table import MIXING_RATIO, RESPONSE, TRUE_WIND

Stamped = tuple[int, str, Any]
# The last version of metadata that rosbag2 of Humble reads; from 9 on, profiles are lists with words.
_BAG_VERSION = 8
_TELL_EVERY = 2000
Progress = Callable[[int], None]


def export_bag(run: RunData, folder: Path, to: str, progress: Callable[[str], None]) -> list[Path]:
    """Write the messages of a run into a new or empty folder.

    Args:
        run: What to write.
        to: `mcap` or `rosbag2`.
        progress: Receives the number of messages.

    Returns:
        The files that were written.
    """
    types = ros_types()

    def report_count(n_messages: int) -> None:
        progress(f"message {n_messages}")

    if to == "mcap":
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{run.run_id}.mcap"
        write_mcap(iterate_messages(run, types), path, types, report_count)
        return [path]
    if folder.exists():
        # Bags make their own folder.
        folder.rmdir()
    folder.parent.mkdir(parents=True, exist_ok=True)
    write_rosbag2(iterate_messages(run, types), folder, types, report_count)
    return sorted(folder.iterdir())


def instrument_topics(run: RunData, types: RosTypes) -> list[Iterator[Stamped]]:
    """Return the messages of all instruments, a stream for each topic, each by time [ns of simulated time]."""
    specs = {(agent.name, sensor.name): sensor for agent in run.scenario.agents for sensor in agent.sensors}
    by_sensor: dict[tuple[str, str], dict[str, RecordedSeries]] = defaultdict(dict)
    for series in run.readings:
        by_sensor[series.agent, series.sensor][series.quantity] = series
    truth: dict[tuple[str, str], dict[str, RecordedSeries]] = defaultdict(dict)
    for series in run.samples:
        truth[series.agent, series.sensor][f"{series.quantity} {series.gas}".strip()] = series
    tick_ns = run.scenario.tick_ns
    streams: list[Iterator[Stamped]] = []
    for (agent, sensor), recorded in by_sensor.items():
        spec = specs[agent, sensor]
        if find_reading_type([*recorded], spec) is not None:
            streams.append(_readings(recorded, agent, spec, types, tick_ns))
    for (agent, sensor), recorded in truth.items():
        for quantity, series in recorded.items():
            topic = f"/truth{topic_of(agent, sensor)}"
            if series.quantity == MIXING_RATIO.name:
                gas = _true_gas(types, series)
                streams.append(_each(series, f"{topic}/{safe_name(series.gas)}", tick_ns, gas))
            elif quantity == TRUE_WIND.name:
                streams.append(_each(series, topic, tick_ns, _true_wind(types, series)))
    seen = (*run.point_clouds, *run.rays)
    streams += [_shapes(run, shapes, specs[shapes.agent, shapes.sensor], types) for shapes in seen]
    for camera in run.pictures:
        streams += [_pictures(camera, types, tick_ns), _calibrations(camera, types, tick_ns)]
    return streams


def _readings(
    series: dict[str, RecordedSeries], agent: str, spec: SensorSpec, types: RosTypes, tick_ns: int
) -> Iterator[Stamped]:
    topic, first = topic_of(agent, spec.name), next(iter(series.values()))
    response = series.get(RESPONSE.name)
    # In clean air, as far as the recording shows: the highest resistance.
    clean = float(np.max(response.value)) if response is not None and response.unit == "ohm" else 0.0
    unit = response.unit if response is not None else ""
    for i, tick in enumerate(first.tick):
        values = {name: each.values[i] for name, each in series.items()}
        time_ns = int(tick) * tick_ns
        yield time_ns, topic, make_reading(types, time_ns, agent, spec, values, unit=unit, clean_air_ohm=clean)


def _each(series: RecordedSeries, topic: str, tick_ns: int, make: Callable[[int, int], Any]) -> Iterator[Stamped]:
    for i, tick in enumerate(series.tick):
        time_ns = int(tick) * tick_ns
        yield time_ns, topic, make(i, time_ns)


def _true_gas(types: RosTypes, series: RecordedSeries) -> Callable[[int, int], Any]:
    frame = frame_of(series.agent, series.sensor)
    return lambda i, time_ns: make_gas(types, types.header(time_ns, frame), float(series.value[i]))


def _true_wind(types: RosTypes, series: RecordedSeries) -> Callable[[int, int], Any]:
    frame = frame_of(series.agent, series.sensor)
    return lambda i, time_ns: make_true_wind(types, time_ns, frame, series.values[i])


def _shapes(run: RunData, shapes: RecordedShapes, spec: SensorSpec, types: RosTypes) -> Iterator[Stamped]:
    topic, tick_ns = topic_of(shapes.agent, shapes.sensor), run.scenario.tick_ns
    is_scan = isinstance(spec, LidarSensorSpec) and spec.model == "lidar_2d"
    for i, tick in enumerate(shapes.tick):
        time_ns = int(tick) * tick_ns
        some = shapes.points_world_m[int(shapes.starts[i]) : int(shapes.starts[i + 1])]
        if is_scan:
            yield time_ns, topic, _scan(run, shapes, spec, types, i, some, time_ns)
        else:
            # Of rays what they met.
            points = some if some.ndim == 2 else some[:, 1]
            yield time_ns, f"{topic}/points", types.cloud(time_ns, points.astype(np.float32), ("x", "y", "z"))


# Points back into the frame of the lidar, from where it saw them; a ray that met nothing is infinite.
def _scan(
    run: RunData, shapes: RecordedShapes, spec: Any, types: RosTypes, i: int, points: Vector, time_ns: int
) -> Any:
    track = run.tracks[shapes.agent]
    seen_at = int(shapes.tick[i]) - round(spec.delay_s / run.tick_s)
    k = int(np.clip(np.searchsorted(track.tick, seen_at), 0, len(track.tick) - 1))
    w, x, y, z = track.quaternion_wxyz[k]
    body_m = (points - track.position_world_m[k]) @ world_from_body_rotation((w, x, y, z))
    local_m = (body_m - np.array(spec.mount_m)) @ rotation_from_rpy(spec.mount_rpy_rad)
    n = spec.lidar.n_azimuths
    first_rad, step_rad = scan_angles(spec)
    ranges = np.full(n, np.inf, dtype=np.float32)
    bearing_rad = np.arctan2(local_m[:, 1], local_m[:, 0])
    at = np.round((bearing_rad - first_rad) / step_rad).astype(np.int64) % n
    ranges[at] = np.linalg.norm(local_m, axis=1)
    return make_scan(types, time_ns, shapes.agent, spec, ranges, run.tick_s)


def _pictures(camera: RecordedPictures, types: RosTypes, tick_ns: int) -> Iterator[Stamped]:
    topic, _ = picture_topic(topic_of(camera.agent, camera.sensor), is_depth=camera.is_depth)
    encoding = "depth_png" if camera.is_depth else camera.media_type.removeprefix("image/")
    for tick, data in zip(camera.tick, camera.data, strict=True):
        time_ns = int(tick) * tick_ns
        yield time_ns, topic, make_picture(types, time_ns, frame_of(camera.agent, camera.sensor), encoding, data)


def _calibrations(camera: RecordedPictures, types: RosTypes, tick_ns: int) -> Iterator[Stamped]:
    topic, frame = topic_of(camera.agent, camera.sensor), frame_of(camera.agent, camera.sensor)
    focal_px, centre_px, size_px = camera.focal_px, camera.centre_px, camera.size_px
    for tick in camera.tick:
        time_ns = int(tick) * tick_ns
        calibration = make_calibration(types, time_ns, frame, focal_px, centre_px, size_px)
        yield time_ns, f"{topic}/camera_info", calibration


@dataclass(frozen=True, kw_only=True, eq=False)
class TimedMessage:
    """A message at a simulated time."""

    time_ns: int
    topic: str
    message: Any

    def __lt__(self, other: "TimedMessage") -> bool:
        return (self.time_ns, self.topic) < (other.time_ns, other.topic)


def iterate_messages(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
    """Return all messages of a run, by time.

    Frames: `map` is the world; `<agent>/base_link` the vehicle, x ahead, y to the left, z up; `<agent>/<sensor>` a
    sensor. Stamps are simulated time, from 0 on.
    """
    tick_ns = run.scenario.tick_ns
    poses = [_poses(track, types, tick_ns) for track in run.tracks.values()]
    instruments = [_timed(stream) for stream in instrument_topics(run, types)]
    return heapq.merge(_stills(run, types), *poses, _waypoints(run, types), _clouds(run, types), *instruments)


def _timed(stream: Iterator[Stamped]) -> Iterator[TimedMessage]:
    for time_ns, topic, message in stream:
        yield TimedMessage(time_ns=time_ns, topic=topic, message=message)


# What does not change: vehicles, the map, the sources, and where sensors are mounted.
def _stills(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
    still = {description_topic(agent.name): make_description(types, agent) for agent in run.scenario.agents}
    still["/map"] = make_map(types, run.scenario, run.environment)
    still["/sources"] = make_sources(types, run.scenario)
    still["/tf_static"] = make_mounts(types, run.scenario)
    for topic in sorted(still):
        yield TimedMessage(time_ns=0, topic=topic, message=still[topic])


def _poses(track: RecordedTrack, types: RosTypes, tick_ns: int) -> Iterator[TimedMessage]:
    agent, base = safe_name(track.agent), base_frame(track.agent)
    velocity_world_m_s, rates_body_rad_s = _velocities(track)
    for i, tick in enumerate(track.tick):
        time_ns = int(tick) * tick_ns
        place_m, turn = track.position_world_m[i], track.quaternion_wxyz[i]
        header, pose = types.header(time_ns, MAP_FRAME), types.pose(place_m, turn)
        body_from_world = world_from_body_rotation((turn[0], turn[1], turn[2], turn[3])).T
        velocity_body_m_s = body_from_world @ velocity_world_m_s[i]
        odometry = make_odometry(types, time_ns, track.agent, place_m, turn, velocity_body_m_s, rates_body_rad_s[i])
        transform = types.transform(time_ns, MAP_FRAME, base, place_m, turn)
        yield TimedMessage(time_ns=time_ns, topic=f"/{agent}/odom", message=odometry)
        yield TimedMessage(
            time_ns=time_ns,
            topic=f"/{agent}/pose",
            message=types.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose),
        )
        yield TimedMessage(
            time_ns=time_ns, topic="/tf", message=types.make("tf2_msgs/msg/TFMessage", transforms=[transform])
        )


# Between neighbouring ticks: recordings hold poses, no velocities.
def _velocities(track: RecordedTrack) -> tuple[Vector, Vector]:
    if len(track.tick) < 2:
        nothing = np.zeros((len(track.tick), 3))
        return nothing, nothing
    velocity_m_s = np.gradient(track.position_world_m, track.time_s, axis=0)
    w, *xyz = track.quaternion_wxyz.T
    turns = np.stack([w, *xyz], axis=1)
    # A quaternion and its opposite are the same attitude.
    signs = np.where(np.sum(turns[1:] * turns[:-1], axis=1) < 0, -1.0, 1.0)
    turns[1:] *= np.cumprod(signs)[:, None]
    change = np.gradient(turns, track.time_s, axis=0)
    # omega = 2 conj(q) dq/dt, the vector part.
    q0, q = turns[:, :1], turns[:, 1:]
    rates = 2 * (q0 * change[:, 1:] - change[:, :1] * q - np.cross(q, change[:, 1:]))
    return velocity_m_s, rates


def _waypoints(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
    marks = [
        (int(tick), agent, i, points.position_world_m[i])
        for agent, points in run.waypoints.items()
        for i, tick in enumerate(points.tick)
    ]
    for tick, agent, i, place_m in sorted(marks, key=lambda mark: mark[:3]):
        time_ns = tick * run.scenario.tick_ns
        marker = make_marker(types, time_ns, "waypoints", i, place_m, WAYPOINT_M, BLUE)
        yield TimedMessage(time_ns=time_ns, topic=f"/{safe_name(agent)}/waypoints", message=marker)


def _clouds(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
    cloud = run.filaments
    for i, tick in enumerate(cloud.tick):
        centres_m, sigmas_m = cloud.snapshot(i)
        time_ns = int(tick) * run.scenario.tick_ns
        message = make_filaments(types, time_ns, centres_m, sigmas_m)
        yield TimedMessage(time_ns=time_ns, topic="/truth/filaments", message=message)


def write_mcap(messages: Iterable[TimedMessage], path: Path, types: RosTypes, progress: Progress) -> None:
    """Write messages into one MCAP file with the profile `ros2`, which Foxglove and `ros2 bag` read.

    Args:
        messages: By time.
        types: Of the messages.
        progress: Receives how many have been written, now and then.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise UsageError(f"mcap: expected the package, found none. Install it with: {REMEDY}") from error
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="gslcosim")
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for i, each in enumerate(messages):
            kind = each.message.__msgtype__
            if kind not in schemas:
                text = types.definition(kind).encode()
                schemas[kind] = writer.register_schema(name=kind, encoding="ros2msg", data=text)
            if each.topic not in channels:
                channels[each.topic] = writer.register_channel(
                    topic=each.topic,
                    message_encoding="cdr",
                    schema_id=schemas[kind],
                    metadata={"offered_qos_profiles": find_qos(each.topic).recorded_text},
                )
            data = types.to_cdr(each.message)
            writer.add_message(channels[each.topic], each.time_ns, data, publish_time=each.time_ns, sequence=i)
            if i % _TELL_EVERY == 0:
                progress(i)
        writer.finish()


def write_rosbag2(messages: Iterable[TimedMessage], folder: Path, types: RosTypes, progress: Progress) -> None:
    """Write messages into a folder of rosbag2, with SQLite and `metadata.yaml`, which `ros2 bag play` reads.

    Args:
        messages: By time.
        folder: The bag; it must not exist.
        types: Of the messages.
        progress: Receives how many have been written, now and then.
    """
    from rosbags.rosbag2 import Writer
    from rosbags.rosbag2.metadata import parse_qos

    with Writer(folder, version=_BAG_VERSION) as bag:
        connections = {}
        for i, each in enumerate(messages):
            if each.topic not in connections:
                kind = each.message.__msgtype__
                offered = parse_qos(find_qos(each.topic).recorded_text)
                connections[each.topic] = bag.add_connection(
                    each.topic, kind, typestore=types.store, offered_qos_profiles=offered
                )
            bag.write(connections[each.topic], each.time_ns, types.to_cdr(each.message))
            if i % _TELL_EVERY == 0:
                progress(i)
