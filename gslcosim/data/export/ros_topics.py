"""ROS 2 topics of a run as messages by time, and bag files of them: one MCAP, or a folder of rosbag2."""

import heapq
import io
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from gslcosim.base.errors import UsageError
from gslcosim.base.frames import quaternion_from_rotation, rotation_from_rpy, world_from_body_rotation
from gslcosim.data.export.tables import safe_name
from gslcosim.data.run import RunData
from gslcosim.data.streams import RecordedPictures, RecordedSeries, RecordedShapes, RecordedTrack
from gslcosim.environment.plan_view import PlanView
from gslcosim.ros import types as ros_types
from gslcosim.ros.types import ANEMOMETER, GAS_SENSOR, MAP_FRAME, REMEDY, RosTypes, Vector
from gslcosim.scenario.models.sensors import (
    LidarSensorSpec,
    ReachingSensorSpec,
    SensorSpec,
    TurnedSensorSpec,
    real_model,
)
from gslcosim_services.recorder.stream_table import (
    ANGULAR_VELOCITY,
    APPARENT_WIND,
    ATTITUDE,
    MAGNETIC_FIELD,
    MIXING_RATIO,
    POSITION,
    PRESSURE,
    RANGE,
    RESPONSE,
    SPECIFIC_FORCE,
    TRUE_WIND,
    WIND_FROM,
    WIND_SPEED,
)

Stamped = tuple[int, str, Any]
# Where local coordinates are on the earth: the corner (0, 0, 0) of the world is at latitude 0 and longitude 0.
_METRES_PER_DEGREE = 40_007_862.9 / 360.0
_TESLA_PER_MICROTESLA = 1e-6
_UNKNOWN_COVARIANCE = 0
_FLAT_RAY_RAD = 0.01
_INFRARED = 1


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
        topic, frame = _topic(agent, sensor), _frame(agent, sensor)
        make = _maker(recorded, spec, types, frame)
        if make is not None:
            first = next(iter(recorded.values()))
            streams.append(_each(first, topic, tick_ns, make))
    for (agent, sensor), recorded in truth.items():
        for quantity, series in recorded.items():
            topic, frame = f"/truth{_topic(agent, sensor)}", _frame(agent, sensor)
            if series.quantity == MIXING_RATIO.name:
                gas = _gas_sensor(types, frame, series, ros_types.UNKNOWN, 0, 0, ros_types.UNITS["ppm"], 0.0)
                streams.append(_each(series, f"{topic}/{safe_name(series.gas)}", tick_ns, gas))
            elif quantity == TRUE_WIND.name:
                streams.append(_each(series, topic, tick_ns, _true_wind(types, series)))
    seen = (*run.point_clouds, *run.rays)
    streams += [_shapes(run, shapes, specs[shapes.agent, shapes.sensor], types) for shapes in seen]
    for camera in run.pictures:
        streams += [_pictures(camera, types, tick_ns), _calibrations(camera, types, tick_ns)]
    return streams


def _topic(agent: str, sensor: str) -> str:
    return f"/{safe_name(agent)}/{safe_name(sensor)}"


def _frame(agent: str, sensor: str) -> str:
    return f"{safe_name(agent)}/{safe_name(sensor)}"


def _each(series: RecordedSeries, topic: str, tick_ns: int, make: Callable[[int, int], Any]) -> Iterator[Stamped]:
    for i, tick in enumerate(series.tick):
        time_ns = int(tick) * tick_ns
        yield time_ns, topic, make(i, time_ns)


# How the i-th reading becomes a message; nothing for instruments that no standard message fits.
def _maker(
    series: dict[str, RecordedSeries], spec: SensorSpec, types: RosTypes, frame: str
) -> Callable[[int, int], Any] | None:
    if RESPONSE.name in series:
        return _gas_reading(series[RESPONSE.name], spec, types, frame)
    if WIND_SPEED.name in series:
        return _wind_reading(series, types, frame)
    if SPECIFIC_FORCE.name in series:
        return _imu(series, types, frame)
    if spec.model == "gps":
        return _fix(series[POSITION.name], types, frame)
    if PRESSURE.name in series:
        return _pressure(series[PRESSURE.name], types, frame)
    if MAGNETIC_FIELD.name in series:
        return _field(series[MAGNETIC_FIELD.name], types, frame)
    if spec.model == "pose":
        return _pose(series, types)
    if spec.model == "range_finder" and isinstance(spec, ReachingSensorSpec):
        return _range(series[RANGE.name], spec.max_range_m, types, frame)
    return None


def _gas_reading(series: RecordedSeries, spec: SensorSpec, types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    technology = {"ohm": ros_types.MOX, "ppm m": ros_types.TDLAS}.get(series.unit, ros_types.UNKNOWN)
    technology = ros_types.PID if real_model(spec.model) == "pid" else technology
    part = ros_types.PARTS.get(real_model(spec.model), 0)
    units = ros_types.UNITS.get(series.unit, 0)
    # In clean air, as far as the recording shows: the highest resistance.
    clean = float(np.max(series.value)) if series.unit == "ohm" else 0.0
    maker = ros_types.FIGARO if technology == ros_types.MOX else 0
    return _gas_sensor(types, frame, series, technology, maker, part, units, clean)


def _gas_sensor(
    types: RosTypes,
    frame: str,
    series: RecordedSeries,
    technology: int,
    manufacturer: int,
    part: int,
    units: int,
    clean: float,
) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        GAS_SENSOR,
        header=types.header(time_ns, frame),
        technology=technology,
        manufacturer=manufacturer,
        mpn=part,
        raw=float(series.value[i]),
        raw_units=units,
        raw_air=clean,
        calib_a=0.0,
        calib_b=0.0,
    )


# GADEN's anemometer tells where the wind blows from, counter-clockwise from x, as ours does; ours is about the world.
def _wind_reading(series: dict[str, RecordedSeries], types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    speed, bearing, vector = series[WIND_SPEED.name], series.get(WIND_FROM.name), series.get(APPARENT_WIND.name)

    def make(i: int, time_ns: int) -> Any:
        from_rad = float(bearing.value[i]) if bearing is not None else _from_rad(vector.values[i] if vector else None)
        return types.make(
            ANEMOMETER,
            header=types.header(time_ns, MAP_FRAME),
            sensor_label=frame,
            wind_speed=float(speed.value[i]),
            wind_direction=from_rad,
        )

    return make


def _true_wind(types: RosTypes, series: RecordedSeries) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        ANEMOMETER,
        header=types.header(time_ns, MAP_FRAME),
        sensor_label=_frame(series.agent, series.sensor),
        wind_speed=float(np.linalg.norm(series.values[i])),
        wind_direction=_from_rad(series.values[i]),
    )


def _from_rad(wind_m_s: Vector | None) -> float:
    return 0.0 if wind_m_s is None else math.atan2(-wind_m_s[1], -wind_m_s[0])


def _imu(series: dict[str, RecordedSeries], types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    # The first number -1 says that there is no attitude.
    no_attitude = np.zeros(9)
    no_attitude[0] = -1.0
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    return lambda i, time_ns: types.make(
        "sensor_msgs/msg/Imu",
        header=types.header(time_ns, frame),
        orientation=types.turn(upright),
        orientation_covariance=no_attitude,
        angular_velocity=types.vector(series[ANGULAR_VELOCITY.name].values[i]),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=types.vector(series[SPECIFIC_FORCE.name].values[i]),
        linear_acceleration_covariance=np.zeros(9),
    )


def _fix(series: RecordedSeries, types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    status = types.make("sensor_msgs/msg/NavSatStatus", status=0, service=1)

    def make(i: int, time_ns: int) -> Any:
        x_m, y_m, z_m = series.values[i]
        return types.make(
            "sensor_msgs/msg/NavSatFix",
            header=types.header(time_ns, frame),
            status=status,
            latitude=float(y_m / _METRES_PER_DEGREE),
            longitude=float(x_m / _METRES_PER_DEGREE),
            altitude=float(z_m),
            position_covariance=np.zeros(9),
            position_covariance_type=_UNKNOWN_COVARIANCE,
        )

    return make


def _pressure(series: RecordedSeries, types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        "sensor_msgs/msg/FluidPressure",
        header=types.header(time_ns, frame),
        fluid_pressure=float(series.value[i]),
        variance=0.0,
    )


def _field(series: RecordedSeries, types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        "sensor_msgs/msg/MagneticField",
        header=types.header(time_ns, frame),
        magnetic_field=types.vector(series.values[i] * _TESLA_PER_MICROTESLA),
        magnetic_field_covariance=np.zeros(9),
    )


def _pose(series: dict[str, RecordedSeries], types: RosTypes) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        "geometry_msgs/msg/PoseStamped",
        header=types.header(time_ns, MAP_FRAME),
        pose=types.pose(series[POSITION.name].values[i], series[ATTITUDE.name].values[i]),
    )


def _range(series: RecordedSeries, max_range_m: float, types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        "sensor_msgs/msg/Range",
        header=types.header(time_ns, frame),
        radiation_type=_INFRARED,
        field_of_view=_FLAT_RAY_RAD,
        min_range=0.0,
        max_range=max_range_m,
        range=float(series.value[i]),
    )


def _shapes(run: RunData, shapes: RecordedShapes, spec: SensorSpec, types: RosTypes) -> Iterator[Stamped]:
    topic, tick_ns = _topic(shapes.agent, shapes.sensor), run.scenario.tick_ns
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
    n, span_rad = spec.lidar.n_azimuths, spec.lidar.azimuth_span_rad
    # As the lidar spreads them: a full turn has no end of its own.
    is_turn = math.isclose(span_rad, 2 * math.pi)
    first_rad, step_rad = -span_rad / 2, span_rad / max(n if is_turn else n - 1, 1)
    ranges = np.full(n, np.inf, dtype=np.float32)
    bearing_rad = np.arctan2(local_m[:, 1], local_m[:, 0])
    at = np.round((bearing_rad - first_rad) / step_rad).astype(np.int64) % n
    ranges[at] = np.linalg.norm(local_m, axis=1)
    return types.make(
        "sensor_msgs/msg/LaserScan",
        header=types.header(time_ns, _frame(shapes.agent, shapes.sensor)),
        angle_min=first_rad,
        angle_max=first_rad + (n - 1) * step_rad,
        angle_increment=step_rad,
        time_increment=0.0,
        scan_time=float(spec.period_s or run.tick_s),
        range_min=0.0,
        range_max=float(spec.max_range_m),
        ranges=ranges,
        intensities=np.zeros(0, dtype=np.float32),
    )


def _pictures(camera: RecordedPictures, types: RosTypes, tick_ns: int) -> Iterator[Stamped]:
    topic, frame = _topic(camera.agent, camera.sensor), _frame(camera.agent, camera.sensor)
    for i, tick in enumerate(camera.tick):
        time_ns = int(tick) * tick_ns
        if camera.is_depth:
            yield time_ns, f"{topic}/image", _depth_image(camera, types, i, time_ns, frame)
            continue
        message = types.make(
            "sensor_msgs/msg/CompressedImage",
            header=types.header(time_ns, frame),
            format=camera.media_type.removeprefix("image/"),
            data=np.frombuffer(camera.data[i], dtype=np.uint8),
        )
        yield time_ns, f"{topic}/image/compressed", message


def _depth_image(camera: RecordedPictures, types: RosTypes, i: int, time_ns: int, frame: str) -> Any:
    depths_mm = np.asarray(Image.open(io.BytesIO(camera.data[i]))).astype("<u2")
    height, width = depths_mm.shape
    return types.make(
        "sensor_msgs/msg/Image",
        header=types.header(time_ns, frame),
        height=height,
        width=width,
        encoding="16UC1",
        is_bigendian=0,
        step=2 * width,
        data=np.frombuffer(depths_mm.tobytes(), dtype=np.uint8),
    )


def _calibrations(camera: RecordedPictures, types: RosTypes, tick_ns: int) -> Iterator[Stamped]:
    (fx, fy), (cx, cy), (width, height) = camera.focal_px, camera.centre_px, camera.size_px
    k = np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0])
    p = np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0])
    region = types.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    topic, frame = _topic(camera.agent, camera.sensor), _frame(camera.agent, camera.sensor)
    for tick in camera.tick:
        time_ns = int(tick) * tick_ns
        yield (
            time_ns,
            f"{topic}/camera_info",
            types.make(
                "sensor_msgs/msg/CameraInfo",
                header=types.header(time_ns, frame),
                height=height,
                width=width,
                distortion_model="plumb_bob",
                d=np.zeros(5),
                k=k,
                r=np.eye(3).ravel(),
                p=p,
                binning_x=0,
                binning_y=0,
                roi=region,
            ),
        )


UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_SOURCE_M, _WAYPOINT_M = 0.3, 0.15
_ADD, _SPHERE = 0, 2
_GREEN, _BLUE = (0.0, 0.62, 0.45, 1.0), (0.0, 0.45, 0.7, 0.8)
_OCCUPIED, _FREE = 100, 0


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


def base_frame(agent: str) -> str:
    """Return the frame of an agent's vehicle."""
    return f"{safe_name(agent)}/base_link"


# What does not change: the map, the sources, and where sensors are mounted.
def _stills(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
    mounts = [
        types.transform(
            0,
            base_frame(agent.name),
            f"{safe_name(agent.name)}/{safe_name(sensor.name)}",
            np.array(sensor.mount_m),
            np.array(
                quaternion_from_rotation(
                    rotation_from_rpy(sensor.mount_rpy_rad if isinstance(sensor, TurnedSensorSpec) else (0, 0, 0))
                )
            ),
        )
        for agent in run.scenario.agents
        for sensor in agent.sensors
    ]
    yield TimedMessage(time_ns=0, topic="/map", message=_map(run, types))
    sources = [
        _marker(types, 0, "sources", i, np.array(source.position_m), _SOURCE_M, _GREEN)
        for i, source in enumerate(run.scenario.gas.sources)
    ]
    yield TimedMessage(
        time_ns=0, topic="/sources", message=types.make("visualization_msgs/msg/MarkerArray", markers=sources)
    )
    yield TimedMessage(time_ns=0, topic="/tf_static", message=types.make("tf2_msgs/msg/TFMessage", transforms=mounts))


# The room cut at the height of the first agent's search.
def _map(run: RunData, types: RosTypes) -> Any:
    plan = PlanView.of(run.environment, run.scenario.agents[0].vehicle.search_height_m)
    grid, (nx, ny) = plan.grid, plan.solid.shape
    return types.make(
        "nav_msgs/msg/OccupancyGrid",
        header=types.header(0, MAP_FRAME),
        info=types.make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=types.time(0),
            resolution=grid.cell_m,
            width=nx,
            height=ny,
            origin=types.pose(np.array([*grid.origin_m[:2], 0.0]), UPRIGHT),
        ),
        # Row by row, x first.
        data=np.where(plan.solid.T, _OCCUPIED, _FREE).astype(np.int8).ravel(),
    )


def _poses(track: RecordedTrack, types: RosTypes, tick_ns: int) -> Iterator[TimedMessage]:
    agent, base = safe_name(track.agent), base_frame(track.agent)
    velocity_world_m_s, rates_body_rad_s = _velocities(track)
    for i, tick in enumerate(track.tick):
        time_ns = int(tick) * tick_ns
        place_m, turn = track.position_world_m[i], track.quaternion_wxyz[i]
        header, pose = types.header(time_ns, MAP_FRAME), types.pose(place_m, turn)
        body_from_world = world_from_body_rotation((turn[0], turn[1], turn[2], turn[3])).T
        twist = types.make(
            "geometry_msgs/msg/Twist",
            linear=types.vector(body_from_world @ velocity_world_m_s[i]),
            angular=types.vector(rates_body_rad_s[i]),
        )
        odometry = types.make(
            "nav_msgs/msg/Odometry",
            header=header,
            child_frame_id=base,
            pose=types.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
            twist=types.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )
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
        marker = _marker(types, time_ns, "waypoints", i, place_m, _WAYPOINT_M, _BLUE)
        yield TimedMessage(time_ns=time_ns, topic=f"/{safe_name(agent)}/waypoints", message=marker)


def _clouds(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
    cloud = run.filaments
    for i, tick in enumerate(cloud.tick):
        centres_m, sigmas_m = cloud.snapshot(i)
        time_ns = int(tick) * run.scenario.tick_ns
        points = np.concatenate([centres_m, sigmas_m[:, None]], axis=1).astype(np.float32)
        yield TimedMessage(
            time_ns=time_ns,
            topic="/truth/filaments",
            message=types.cloud(time_ns, points, ("x", "y", "z", "sigma")),
        )


def _marker(
    types: RosTypes,
    time_ns: int,
    namespace: str,
    number: int,
    place_m: Vector,
    size_m: float,
    rgba: tuple[float, float, float, float],
) -> Any:
    red, green, blue, alpha = rgba
    nothing = np.zeros(0, dtype=np.uint8)
    return types.make(
        "visualization_msgs/msg/Marker",
        header=types.header(time_ns, MAP_FRAME),
        ns=namespace,
        id=number,
        type=_SPHERE,
        action=_ADD,
        pose=types.pose(place_m, UPRIGHT),
        scale=types.vector(np.full(3, size_m)),
        color=types.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=types.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=[],
        colors=[],
        texture_resource="",
        texture=types.make("sensor_msgs/msg/CompressedImage", header=types.header(0, ""), format="", data=nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=types.make("visualization_msgs/msg/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )


# Rosbag2's own number for what bags of Humble and later look like.
_BAG_VERSION = 9
_TELL_EVERY = 2000
Progress = Callable[[int], None]


def write_mcap(messages: Iterable[TimedMessage], path: Path, types: RosTypes, progress: Progress) -> None:
    """Write messages into one MCAP file with the profile `ros2`, which Foxglove and `ros2 bag` read.

    Args:
        messages: By time.
        path: The file.
        types: Of the messages.
        progress: Receives how many have been written, now and then.

    Raises:
        UsageError: the extra `ros` is not installed.
        OSError: the machine refuses.
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
                    topic=each.topic, message_encoding="cdr", schema_id=schemas[kind]
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

    Raises:
        OSError: the machine refuses.
    """
    from rosbags.rosbag2 import Writer

    with Writer(folder, version=_BAG_VERSION) as bag:
        connections = {}
        for i, each in enumerate(messages):
            if each.topic not in connections:
                kind = each.message.__msgtype__
                connections[each.topic] = bag.add_connection(each.topic, kind, typestore=types.store)
            bag.write(connections[each.topic], each.time_ns, types.to_cdr(each.message))
            if i % _TELL_EVERY == 0:
                progress(i)
