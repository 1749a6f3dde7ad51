"""The streams of a run as messages of ROS 2: poses, instruments, the map, markers, gas and wind."""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from gslcosim.environment.model import Cell
from gslcosim.extraction.ros_instruments import Stamped, instrument_topics
from gslcosim.extraction.ros_types import MAP_FRAME, RosTypes, Vector
from gslcosim.extraction.stream_tables import safe_name
from gslcosim.frames import quaternion_from_rotation, rotation_from_rpy, world_from_body_rotation
from gslcosim.run_data.opening import RunData
from gslcosim.run_data.recorded_streams import RecordedTrack
from gslcosim.scenario.models.sensor_base import TurnedSensorSpec

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


def messages_of(run: RunData, types: RosTypes) -> Iterator[TimedMessage]:
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
    environment = run.environment
    grid, height_m = environment.grid, run.scenario.agents[0].vehicle.search_height_m
    level = int(np.clip((height_m - grid.origin_m[2]) / grid.cell_m, 0, grid.shape[2] - 1))
    is_solid = environment.occupancy[:, :, level] == Cell.SOLID
    nx, ny, _ = grid.shape
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
        data=np.where(is_solid.T, _OCCUPIED, _FREE).astype(np.int8).ravel(),
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
