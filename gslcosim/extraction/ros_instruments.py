"""Readings and true samples as messages of ROS 2, one topic for each instrument."""

import io
import math
from collections import defaultdict
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from PIL import Image

from gslcosim.extraction import ros_types
from gslcosim.extraction.ros_types import ANEMOMETER, GAS_SENSOR, MAP_FRAME, RosTypes, Vector
from gslcosim.extraction.stream_tables import safe_name
from gslcosim.frames import rotation_from_rpy, world_from_body_rotation
from gslcosim.run_data.opening import RunData
from gslcosim.run_data.recorded_streams import RecordedPictures, RecordedSeries, RecordedShapes
from gslcosim.scenario.models.onboard import LidarSensorSpec
from gslcosim.scenario.models.sensor_base import ReachingSensorSpec, SensorSpec

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
    for (agent, sensor), told in by_sensor.items():
        spec = specs[agent, sensor]
        topic, frame = _topic(agent, sensor), _frame(agent, sensor)
        make = _maker(told, spec, types, frame)
        if make is not None:
            first = next(iter(told.values()))
            streams.append(_each(first, topic, tick_ns, make))
    for (agent, sensor), told in truth.items():
        for quantity, series in told.items():
            topic, frame = f"/truth{_topic(agent, sensor)}", _frame(agent, sensor)
            if series.quantity == "mixing_ratio":
                gas = _gas_sensor(types, frame, series, ros_types.UNKNOWN, 0, 0, ros_types.UNITS["ppm"], 0.0)
                streams.append(_each(series, f"{topic}/{safe_name(series.gas)}", tick_ns, gas))
            elif quantity == "wind":
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
    told: dict[str, RecordedSeries], spec: SensorSpec, types: RosTypes, frame: str
) -> Callable[[int, int], Any] | None:
    if "response" in told:
        return _gas_reading(told["response"], spec, types, frame)
    if "wind_speed" in told:
        return _wind_reading(told, types, frame)
    if "specific_force" in told:
        return _imu(told, types, frame)
    if spec.model == "gps":
        return _fix(told["position"], types, frame)
    if "pressure" in told:
        return _pressure(told["pressure"], types, frame)
    if "magnetic_field" in told:
        return _field(told["magnetic_field"], types, frame)
    if spec.model == "pose":
        return _pose(told, types)
    if spec.model == "range_finder" and isinstance(spec, ReachingSensorSpec):
        return _range(told["range"], spec.max_range_m, types, frame)
    return None


def _gas_reading(series: RecordedSeries, spec: SensorSpec, types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    technology = {"ohm": ros_types.MOX, "ppm m": ros_types.TDLAS}.get(series.unit, ros_types.UNKNOWN)
    technology = ros_types.PID if spec.model == "pid" else technology
    part = ros_types.PARTS.get(spec.model, 0)
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
def _wind_reading(told: dict[str, RecordedSeries], types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    speed, bearing, vector = told["wind_speed"], told.get("wind_from"), told.get("apparent_wind")

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


def _imu(told: dict[str, RecordedSeries], types: RosTypes, frame: str) -> Callable[[int, int], Any]:
    # The first number -1 says that there is no attitude.
    no_attitude = np.zeros(9)
    no_attitude[0] = -1.0
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    return lambda i, time_ns: types.make(
        "sensor_msgs/msg/Imu",
        header=types.header(time_ns, frame),
        orientation=types.turn(upright),
        orientation_covariance=no_attitude,
        angular_velocity=types.vector(told["angular_velocity"].values[i]),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=types.vector(told["specific_force"].values[i]),
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


def _pose(told: dict[str, RecordedSeries], types: RosTypes) -> Callable[[int, int], Any]:
    return lambda i, time_ns: types.make(
        "geometry_msgs/msg/PoseStamped",
        header=types.header(time_ns, MAP_FRAME),
        pose=types.pose(told["position"].values[i], told["attitude_quaternion"].values[i]),
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
