"""Messages of ROS 2 made of what a run writes: one maker for bags and for live topics.

What a sensor reports comes by stream (`recorder.stream_table`), whether a recording or a reading holds it.
"""

import io
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gslcosim.base.frames import quaternion_from_rotation, rotation_from_rpy
from gslcosim.contract.messages import CameraImage, Reading
from gslcosim.environment.model import Environment
from gslcosim.environment.plan_view import PlanView
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim.scenario.models.sensors import (
    LidarSensorSpec,
    ReachingSensorSpec,
    SensorSpec,
    TurnedSensorSpec,
    real_model,
)
from gslcosim_ros import types as ros_types
from gslcosim_ros.types import ANEMOMETER, GAS_SENSOR, MAP_FRAME, RosTypes, Vector
from gslcosim_ros.vehicle_urdf import build_urdf
from gslcosim_ros.wire import LATCHED, QosProfile
from gslcosim_services.recorder.stream_table import (
    ANGULAR_VELOCITY,
    APPARENT_WIND,
    ATTITUDE,
    MAGNETIC_FIELD,
    ON_BOARD_STREAMS,
    POSITION,
    PRESSURE,
    RANGE,
    RESPONSE,
    SPECIFIC_FORCE,
    WIND_FROM,
    WIND_SPEED,
    split_values,
)
from gslcosim_services.sensing.models.anemometer import QUANTITY as WIND_QUANTITY

Values = Mapping[str, Vector]
"""Numbers that a sensor reports at one instant, by name of the stream."""

QUEUED = QosProfile(depth=1000)
"""Of a run that is faster than its readers: what they have not read yet."""

# By the last part of a topic; all others are queued. RViz and tf2 ask for these as transient local.
_QOS: Mapping[str, QosProfile] = {
    "map": LATCHED,
    "tf_static": LATCHED,
    "sources": LATCHED,
    "robot_description": LATCHED,
    "waypoints": QosProfile(is_transient_local=True, depth=QUEUED.depth),
}

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
GREEN, BLUE = (0.0, 0.62, 0.45, 1.0), (0.0, 0.45, 0.7, 0.8)
SOURCE_M, WAYPOINT_M = 0.3, 0.15
# Where local coordinates are on the earth: the corner (0, 0, 0) of the world is at latitude 0 and longitude 0.
_METRES_PER_DEGREE = 40_007_862.9 / 360.0
_TESLA_PER_MICROTESLA = 1e-6
_UNKNOWN_COVARIANCE = 0
_FLAT_RAY_RAD = 0.01
_INFRARED = 1
# Of visualization_msgs/Marker.
_ADD, _DELETE = 0, 2
SPHERE, LINE_STRIP, SPHERE_LIST = 2, 4, 7
TRACK_M = 0.03
# Of filaments, by size: each class is twice as large as the one before, and fainter.
_SMALLEST_SIGMA_M, _N_SIZES, _SMALLEST_OPACITY = 0.05, 6, 0.6
_MAX_PLUME_POINTS = 2000
_OCCUPIED, _FREE = 100, 0


def topic_part(name: str) -> str:
    """Return a name of a run as a part of a topic's or frame's name: letters, digits and underscores."""
    part = re.sub(r"\W+", "_", name)
    return f"_{part}" if part[:1].isdigit() else part


def find_qos(topic: str) -> QosProfile:
    """Return the quality of service that a topic offers, live and in bags."""
    return _QOS.get(topic.rpartition("/")[2], QUEUED)


def topic_of(agent: str, sensor: str) -> str:
    """Return the topic of a sensor."""
    return f"/{topic_part(agent)}/{topic_part(sensor)}"


def frame_of(agent: str, sensor: str) -> str:
    """Return the frame of a sensor."""
    return f"{topic_part(agent)}/{topic_part(sensor)}"


def base_frame(agent: str) -> str:
    """Return the frame of an agent's vehicle."""
    return f"{topic_part(agent)}/base_link"


# --- what sensors report


def values_by_stream(reading: Reading, model: str) -> dict[str, Vector]:
    """Return the numbers of a reading by stream, as a recording of it would hold them; none of what has no message."""
    values = np.array(reading.values, dtype=np.float64)
    if (streams := ON_BOARD_STREAMS.get(model)) is not None:
        return {stream.name: values[part] for stream, part in zip(streams, split_values(streams), strict=True)}
    if reading.quantity != WIND_QUANTITY:
        return {RESPONSE.name: values}
    if reading.unit.endswith("rad"):
        return {WIND_SPEED.name: values[:1], WIND_FROM.name: values[1:]}
    return {WIND_SPEED.name: np.array([float(np.linalg.norm(values))]), APPARENT_WIND.name: values}


def find_reading_type(names: Sequence[str], sensor: SensorSpec) -> str | None:
    """Return the message type of a sensor whose readings have streams of these names; None where none fits."""
    by_stream = {
        RESPONSE.name: GAS_SENSOR,
        WIND_SPEED.name: ANEMOMETER,
        SPECIFIC_FORCE.name: "sensor_msgs/msg/Imu",
        PRESSURE.name: "sensor_msgs/msg/FluidPressure",
        MAGNETIC_FIELD.name: "sensor_msgs/msg/MagneticField",
    }
    by_model = {"gps": "sensor_msgs/msg/NavSatFix", "pose": "geometry_msgs/msg/PoseStamped"}
    if sensor.model == "range_finder" and isinstance(sensor, ReachingSensorSpec):
        return "sensor_msgs/msg/Range"
    return next((by_stream[name] for name in names if name in by_stream), by_model.get(sensor.model))


def make_reading(
    types: RosTypes,
    time_ns: int,
    agent: str,
    sensor: SensorSpec,
    values: Values,
    *,
    unit: str,
    clean_air_ohm: float = 0.0,
) -> Any:
    """Return the message of a sensor's reading, of `find_reading_type`.

    Args:
        types: Of messages.
        unit: Of a gas sensor's response.
        clean_air_ohm: Of a MOX sensor, its resistance in clean air [ohm]; 0 where it is not known.
    """
    kind, frame = find_reading_type([*values], sensor), frame_of(agent, sensor.name)
    header = types.header(time_ns, frame)
    match kind:
        case ros_types.GAS_SENSOR:
            return _make_gas_reading(types, header, sensor, values, unit, clean_air_ohm)
        case ros_types.ANEMOMETER:
            return _make_wind_reading(types, time_ns, frame, values)
        case "sensor_msgs/msg/Imu":
            return _make_imu(types, header, values)
        case "sensor_msgs/msg/NavSatFix":
            return _make_fix(types, header, values[POSITION.name])
        case "sensor_msgs/msg/FluidPressure":
            pressure_pa = float(values[PRESSURE.name][0])
            return types.make(kind, header=header, fluid_pressure=pressure_pa, variance=0.0)
        case "sensor_msgs/msg/MagneticField":
            field = types.vector(values[MAGNETIC_FIELD.name] * _TESLA_PER_MICROTESLA)
            return types.make(kind, header=header, magnetic_field=field, magnetic_field_covariance=np.zeros(9))
        case "geometry_msgs/msg/PoseStamped":
            pose = types.pose(values[POSITION.name], values[ATTITUDE.name])
            return types.make(kind, header=types.header(time_ns, MAP_FRAME), pose=pose)
        case "sensor_msgs/msg/Range" if isinstance(sensor, ReachingSensorSpec):
            return types.make(
                kind,
                header=header,
                radiation_type=_INFRARED,
                field_of_view=_FLAT_RAY_RAD,
                min_range=0.0,
                max_range=sensor.max_range_m,
                range=float(values[RANGE.name][0]),
            )
        case _:
            raise AssertionError(f"no message for {sensor.model}")


def _make_gas_reading(
    types: RosTypes, header: Any, sensor: SensorSpec, values: Values, unit: str, clean_air_ohm: float
) -> Any:
    technology = {"ohm": ros_types.MOX, "ppm m": ros_types.TDLAS}.get(unit, ros_types.UNKNOWN)
    technology = ros_types.PID if real_model(sensor.model) == "pid" else technology
    return make_gas(
        types,
        header,
        float(values[RESPONSE.name][0]),
        technology=technology,
        manufacturer=ros_types.FIGARO if technology == ros_types.MOX else 0,
        part=ros_types.PARTS.get(real_model(sensor.model), 0),
        units=ros_types.UNITS.get(unit, 0),
        clean_air_ohm=clean_air_ohm if unit == "ohm" else 0.0,
    )


def make_gas(
    types: RosTypes,
    header: Any,
    raw: float,
    *,
    technology: int = ros_types.UNKNOWN,
    manufacturer: int = 0,
    part: int = 0,
    units: int = ros_types.UNITS["ppm"],
    clean_air_ohm: float = 0.0,
) -> Any:
    """Return a message of a gas sensor; by default of the true mixing ratio [ppm]."""
    return types.make(
        GAS_SENSOR,
        header=header,
        technology=technology,
        manufacturer=manufacturer,
        mpn=part,
        raw=raw,
        raw_units=units,
        raw_air=clean_air_ohm,
        calib_a=0.0,
        calib_b=0.0,
    )


# GADEN's anemometer tells where the wind blows from, counter-clockwise from x, as ours does; ours is about the world.
def _make_wind_reading(types: RosTypes, time_ns: int, frame: str, values: Values) -> Any:
    bearing = values.get(WIND_FROM.name)
    from_rad = float(bearing[0]) if bearing is not None else _from_rad(values.get(APPARENT_WIND.name))
    return _make_anemometer(types, time_ns, frame, float(values[WIND_SPEED.name][0]), from_rad)


def make_true_wind(types: RosTypes, time_ns: int, frame: str, wind_world_m_s: Vector) -> Any:
    """Return a message of the true wind at a sensor."""
    speed_m_s = float(np.linalg.norm(wind_world_m_s))
    return _make_anemometer(types, time_ns, frame, speed_m_s, _from_rad(wind_world_m_s))


def _make_anemometer(types: RosTypes, time_ns: int, frame: str, speed_m_s: float, from_rad: float) -> Any:
    return types.make(
        ANEMOMETER,
        header=types.header(time_ns, MAP_FRAME),
        sensor_label=frame,
        wind_speed=speed_m_s,
        wind_direction=from_rad,
    )


def _from_rad(wind_m_s: Vector | None) -> float:
    return 0.0 if wind_m_s is None else math.atan2(-wind_m_s[1], -wind_m_s[0])


def _make_imu(types: RosTypes, header: Any, values: Values) -> Any:
    # The first number -1 says that there is no attitude.
    no_attitude = np.zeros(9)
    no_attitude[0] = -1.0
    return types.make(
        "sensor_msgs/msg/Imu",
        header=header,
        orientation=types.quaternion(UPRIGHT),
        orientation_covariance=no_attitude,
        angular_velocity=types.vector(values[ANGULAR_VELOCITY.name]),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=types.vector(values[SPECIFIC_FORCE.name]),
        linear_acceleration_covariance=np.zeros(9),
    )


def _make_fix(types: RosTypes, header: Any, position_m: Vector) -> Any:
    return types.make(
        "sensor_msgs/msg/NavSatFix",
        header=header,
        status=types.make("sensor_msgs/msg/NavSatStatus", status=0, service=1),
        latitude=float(position_m[1] / _METRES_PER_DEGREE),
        longitude=float(position_m[0] / _METRES_PER_DEGREE),
        altitude=float(position_m[2]),
        position_covariance=np.zeros(9),
        position_covariance_type=_UNKNOWN_COVARIANCE,
    )


def scan_angles(sensor: LidarSensorSpec) -> tuple[float, float]:
    """Return the first bearing of a lidar and the step to the next [rad], as it spreads its rays."""
    n, span_rad = sensor.lidar.n_azimuths, sensor.lidar.azimuth_span_rad
    # A full turn has no end of its own.
    is_turn = math.isclose(span_rad, 2 * math.pi)
    return -span_rad / 2, span_rad / max(n if is_turn else n - 1, 1)


def make_scan(
    types: RosTypes, time_ns: int, agent: str, sensor: LidarSensorSpec, ranges_m: NDArray[np.float32], tick_s: float
) -> Any:
    """Return the scan of a lidar of one level; a ray that met nothing is infinite."""
    first_rad, step_rad = scan_angles(sensor)
    return types.make(
        "sensor_msgs/msg/LaserScan",
        header=types.header(time_ns, frame_of(agent, sensor.name)),
        angle_min=first_rad,
        angle_max=first_rad + (len(ranges_m) - 1) * step_rad,
        angle_increment=step_rad,
        time_increment=0.0,
        scan_time=float(sensor.period_s or tick_s),
        range_min=0.0,
        range_max=float(sensor.max_range_m),
        ranges=ranges_m,
        intensities=np.zeros(0, dtype=np.float32),
    )


def make_picture(types: RosTypes, time_ns: int, frame: str, encoding: str, data: bytes) -> Any:
    """Return a picture as it travelled: `png` or `jpeg`, or the depths [mm] of a `depth_png`."""
    header = types.header(time_ns, frame)
    if encoding != "depth_png":
        return types.make(
            "sensor_msgs/msg/CompressedImage", header=header, format=encoding, data=np.frombuffer(data, dtype=np.uint8)
        )
    depths_mm = np.asarray(Image.open(io.BytesIO(data))).astype("<u2")
    height, width = depths_mm.shape
    return types.make(
        "sensor_msgs/msg/Image",
        header=header,
        height=height,
        width=width,
        encoding="16UC1",
        is_bigendian=0,
        step=2 * width,
        data=np.frombuffer(depths_mm.tobytes(), dtype=np.uint8),
    )


def picture_topic(topic: str, *, is_depth: bool) -> tuple[str, str]:
    """Return the topic of a camera's pictures, and their type."""
    if is_depth:
        return f"{topic}/image", "sensor_msgs/msg/Image"
    return f"{topic}/image/compressed", "sensor_msgs/msg/CompressedImage"


def make_calibration(
    types: RosTypes,
    time_ns: int,
    frame: str,
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    size_px: tuple[int, int],
) -> Any:
    """Return the calibration of a camera without distortion."""
    (fx, fy), (cx, cy), (width, height) = focal_px, centre_px, size_px
    region = types.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return types.make(
        "sensor_msgs/msg/CameraInfo",
        header=types.header(time_ns, frame),
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0]),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def calibrate_image(types: RosTypes, time_ns: int, frame: str, image: CameraImage) -> Any:
    """Return the calibration that travels with a picture."""
    focal_px, size_px = (image.focal_px, image.focal_px), (image.width_px, image.height_px)
    return make_calibration(types, time_ns, frame, focal_px, image.centre_px, size_px)


# --- vehicles, the room and what is in it


def make_odometry(
    types: RosTypes,
    time_ns: int,
    agent: str,
    position_m: Vector,
    quaternion_wxyz: Vector,
    velocity_body_m_s: Vector,
    rates_body_rad_s: Vector,
) -> Any:
    """Return where a vehicle is in the world, and its velocities in its own frame."""
    pose = types.pose(position_m, quaternion_wxyz)
    twist = types.make(
        "geometry_msgs/msg/Twist", linear=types.vector(velocity_body_m_s), angular=types.vector(rates_body_rad_s)
    )
    return types.make(
        "nav_msgs/msg/Odometry",
        header=types.header(time_ns, MAP_FRAME),
        child_frame_id=base_frame(agent),
        pose=types.make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        twist=types.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
    )


def description_topic(agent: str) -> str:
    """Return the topic of an agent's URDF."""
    return topic_of(agent, "robot_description")


def make_description(types: RosTypes, agent: AgentSpec) -> Any:
    """Return the URDF of an agent's vehicle as a text."""
    return types.make("std_msgs/msg/String", data=build_urdf(agent.vehicle.facts, base_frame(agent.name)))


def make_mounts(types: RosTypes, scenario: Scenario) -> Any:
    """Return where sensors are mounted on their vehicles."""
    mounts = [
        types.transform(
            0,
            base_frame(agent.name),
            frame_of(agent.name, sensor.name),
            np.array(sensor.mount_m),
            np.array(
                quaternion_from_rotation(
                    rotation_from_rpy(sensor.mount_rpy_rad if isinstance(sensor, TurnedSensorSpec) else (0, 0, 0))
                )
            ),
        )
        for agent in scenario.agents
        for sensor in agent.sensors
    ]
    return types.make("tf2_msgs/msg/TFMessage", transforms=mounts)


def make_map(types: RosTypes, scenario: Scenario, environment: Environment) -> Any:
    """Return the room cut at the height of the first agent's search."""
    plan = PlanView.of(environment, scenario.agents[0].vehicle.search_height_m)
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


def make_sources(types: RosTypes, scenario: Scenario) -> Any:
    """Return markers of the true sources."""
    sources = [
        make_marker(types, 0, "sources", i, np.array(source.position_m), SOURCE_M, GREEN)
        for i, source in enumerate(scenario.gas.sources)
    ]
    return types.make("visualization_msgs/msg/MarkerArray", markers=sources)


def make_marker(
    types: RosTypes,
    time_ns: int,
    namespace: str,
    number: int,
    position_m: Vector,
    size_m: float,
    rgba: tuple[float, float, float, float],
    *,
    shape: int = SPHERE,
    points: Sequence[Any] = (),
) -> Any:
    """Return a marker: a sphere, or what is drawn of many points.

    Args:
        types: Of messages.
        namespace: Of its number.
        number: Of the marker; a later one with the same takes its place.
        position_m: Where it is, or what points are given from.
        size_m: Diameter of a sphere, width of a line [m].
        shape: SPHERE, or LINE_STRIP or SPHERE_LIST of points.
        points: Of a line or a list of spheres; without any the marker is taken away.
    """
    red, green, blue, alpha = rgba
    nothing = np.zeros(0, dtype=np.uint8)
    return types.make(
        "visualization_msgs/msg/Marker",
        header=types.header(time_ns, MAP_FRAME),
        ns=namespace,
        id=number,
        type=shape,
        action=_ADD if shape == SPHERE or points else _DELETE,
        pose=types.pose(position_m, UPRIGHT),
        scale=types.vector(np.full(3, size_m)),
        color=types.make("std_msgs/msg/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=types.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
        frame_locked=False,
        points=list(points),
        colors=[],
        texture_resource="",
        texture=types.make("sensor_msgs/msg/CompressedImage", header=types.header(0, ""), format="", data=nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=types.make("visualization_msgs/msg/MeshFile", filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )


def make_filaments(types: RosTypes, time_ns: int, centres_m: Vector, sigmas_m: Vector) -> Any:
    """Return the cloud of filaments with their sizes `sigma` [m]."""
    points = np.concatenate([centres_m, sigmas_m[:, None]], axis=1).astype(np.float32)
    return types.cloud(time_ns, points, ("x", "y", "z", "sigma"))


def make_plume(types: RosTypes, time_ns: int, centres_m: Vector, sigmas_m: Vector) -> Any:
    """Return filaments as markers, a list of spheres for each class of size; some of them where they are many."""
    stride = 1 + (len(centres_m) - 1) // _MAX_PLUME_POINTS
    centres_m, sigmas_m = centres_m[::stride], sigmas_m[::stride]
    sizes = np.log2(np.maximum(sigmas_m, _SMALLEST_SIGMA_M) / _SMALLEST_SIGMA_M).astype(np.int64)
    markers: list[Any] = []
    for size in range(_N_SIZES):
        points = [types.point(centre_m) for centre_m in centres_m[np.minimum(sizes, _N_SIZES - 1) == size]]
        colour = (*GREEN[:3], _SMALLEST_OPACITY / 2**size)
        diameter_m = 2 * _SMALLEST_SIGMA_M * 2**size
        markers.append(
            make_marker(
                types, time_ns, "plume", size, np.zeros(3), diameter_m, colour, shape=SPHERE_LIST, points=points
            )
        )
    return types.make("visualization_msgs/msg/MarkerArray", markers=markers)


class Track:
    """Line of the places where a vehicle has been, as markers; fewer where they become many.

    Args:
        types: Of messages.
    """

    _MAX_POINTS = 500

    def __init__(self, types: RosTypes) -> None:
        self._types = types
        self._spacing_m = 0.05
        self._places_m: list[Vector] = []
        self._points: list[Any] = []

    def add(self, position_m: Vector) -> None:
        """Add where the vehicle is, if it is far enough from the last of the places."""
        if self._places_m and np.linalg.norm(position_m - self._places_m[-1]) < self._spacing_m:
            return
        self._places_m.append(position_m)
        self._points.append(self._types.point(position_m))
        if len(self._points) > self._MAX_POINTS:
            self._spacing_m *= 2
            del self._places_m[1:-1:2], self._points[1:-1:2]

    def make_markers(self, time_ns: int) -> Any:
        """Return the line at a simulated time [ns]."""
        # A line has two ends.
        points = self._points if len(self._points) > 1 else ()
        line = make_marker(
            self._types, time_ns, "track", 0, np.zeros(3), TRACK_M, BLUE, shape=LINE_STRIP, points=points
        )
        return self._types.make("visualization_msgs/msg/MarkerArray", markers=[line])
