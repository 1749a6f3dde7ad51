"""ROS 2 message types of runs: the standard ones, and GADEN's for gas and wind."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError

REMEDY = "pip install 'gslcosim[ros]'"
GAS_SENSOR = "olfaction_msgs/msg/GasSensor"
ANEMOMETER = "olfaction_msgs/msg/Anemometer"
# The frame of the world.
MAP_FRAME = "map"

# The fields of MAPIRlab's olfaction_msgs, which GADEN's simulated instruments publish; its numbers are in `TECHNOLOGY`.
_GAS_SENSOR_FIELDS = """
std_msgs/Header header
uint8 technology
uint8 manufacturer
uint8 mpn
float64 raw
uint8 raw_units
float64 raw_air
float64 calib_a
float64 calib_b
"""
_ANEMOMETER_FIELDS = """
std_msgs/Header header
string sensor_label
float32 wind_speed
float32 wind_direction
"""
# Numbers of olfaction_msgs/GasSensor: technology, manufacturer (Figaro) and part; units.
UNKNOWN, MOX, PID, TDLAS = 0, 1, 51, 53
FIGARO = 1
PARTS = {"tgs2620": 50, "tgs2600": 51, "tgs2611": 52, "tgs2610": 53, "tgs2612": 54}
UNITS = {"ppm": 3, "ohm": 5, "ppm m": 6}
# Of sensor_msgs/PointField.
_FLOAT32 = 7

Vector = NDArray[np.float64]


class RosTypes:
    """Makes messages of ROS 2 and writes them as CDR.

    Raises:
        UsageError: the extra `ros` is not installed.
    """

    def __init__(self) -> None:
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError as error:
            raise UsageError(f"rosbags: expected the package, found none. Install it with: {REMEDY}") from error
        self.store: Any = get_typestore(Stores.ROS2_HUMBLE)
        self.store.register(get_types_from_msg(_GAS_SENSOR_FIELDS, GAS_SENSOR))
        self.store.register(get_types_from_msg(_ANEMOMETER_FIELDS, ANEMOMETER))

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message of a type such as `nav_msgs/msg/Odometry`."""
        return self.store.types[kind](**fields)

    def to_cdr(self, message: Any) -> bytes:
        """Return a message's bytes."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def definition(self, kind: str) -> str:
        """Return the text that defines a type, with those of the types in it."""
        return self.store.generate_msgdef(kind, ros_version=2)[0]

    def time(self, time_ns: int) -> Any:
        """Return a time."""
        sec, nanosec = divmod(time_ns, 1_000_000_000)
        return self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def header(self, time_ns: int, frame: str) -> Any:
        """Return a header."""
        return self.make("std_msgs/msg/Header", stamp=self.time(time_ns), frame_id=frame)

    def vector(self, values: Vector) -> Any:
        """Return a vector of three numbers."""
        x, y, z = (float(value) for value in values)
        return self.make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)

    def point(self, values: Vector) -> Any:
        """Return a place."""
        x, y, z = (float(value) for value in values)
        return self.make("geometry_msgs/msg/Point", x=x, y=y, z=z)

    def turn(self, quaternion_wxyz: Vector) -> Any:
        """Return an attitude."""
        w, x, y, z = (float(value) for value in quaternion_wxyz)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, position_m: Vector, quaternion_wxyz: Vector) -> Any:
        """Return a pose."""
        return self.make(
            "geometry_msgs/msg/Pose", position=self.point(position_m), orientation=self.turn(quaternion_wxyz)
        )

    def transform(self, time_ns: int, frame: str, child: str, position_m: Vector, quaternion_wxyz: Vector) -> Any:
        """Return where a frame is in another."""
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(time_ns, frame),
            child_frame_id=child,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.vector(position_m),
                rotation=self.turn(quaternion_wxyz),
            ),
        )

    def cloud(self, time_ns: int, points: NDArray[np.float32], names: tuple[str, ...]) -> Any:
        """Return points in the world as a cloud, (n, k) with a name for each of the k numbers."""
        fields = [
            self.make("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=_FLOAT32, count=1)
            for i, name in enumerate(names)
        ]
        step = 4 * len(names)
        return self.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(time_ns, MAP_FRAME),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=step,
            row_step=step * len(points),
            data=np.frombuffer(np.ascontiguousarray(points, dtype="<f4").tobytes(), dtype=np.uint8),
            is_dense=True,
        )


@cache
def ros_types() -> RosTypes:
    """Return the types, made once.

    Raises:
        UsageError: the extra `ros` is not installed.
    """
    return RosTypes()
