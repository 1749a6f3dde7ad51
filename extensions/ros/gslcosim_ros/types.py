"""ROS 2 message types of runs: the standard ones, GADEN's for gas and wind, and those that are defined by text."""

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import UsageError
from gslcosim.base.ticks import NS_PER_S
from gslcosim_ros.ros_graphs import RosDistribution
from gslcosim_ros.wire import NO_HASH

REMEDY = "pip install gslcosim-ros"
GAS_SENSOR = "olfaction_msgs/msg/GasSensor"
ANEMOMETER = "olfaction_msgs/msg/Anemometer"
CANCEL_GOAL = "action_msgs/srv/CancelGoal"
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

# Fields that types have since jazzy.
_LATER_FIELDS = {"sensor_msgs/msg/Range": {"variance": 0.0}}

Vector = NDArray[np.float64]


# In ROS 2 a `char` of a `.msg` file is a `uint8`, of which hashes are made, too; rosbags leaves it as it is.
def _without_char(field: Any) -> Any:
    if field == ("char", 0):
        return ("uint8", 0)
    return tuple(_without_char(part) for part in field) if isinstance(field, tuple) else field


class RosTypes:
    """Makes messages of ROS 2, writes them as CDR and reads them.

    A service is known by the types of its request and response, for example `std_srvs/srv/Trigger_Request`.
    """

    def __init__(self, distribution: RosDistribution = "humble") -> None:
        try:
            from rosbags.typesys import Stores, get_types_from_msg, get_typestore
        except ImportError as error:
            raise UsageError(f"rosbags: expected the package, found none. Install it with: {REMEDY}") from error
        self.distribution: RosDistribution = distribution
        self.store: Any = get_typestore(Stores[f"ROS2_{distribution.upper()}"])
        for kind, (constants, fields) in self.store.fielddefs.items():
            self.store.fielddefs[kind] = (constants, [(name, _without_char(field)) for name, field in fields])
        self._parse = get_types_from_msg
        self._hashes: dict[str, str] = {}
        self.define_message(GAS_SENSOR, _GAS_SENSOR_FIELDS)
        self.define_message(ANEMOMETER, _ANEMOMETER_FIELDS)

    def define_message(self, kind: str, fields: str) -> None:
        """Add a message type by the text of its `.msg` file; the types that it uses are known already.

        Args:
            kind: Such as `gaden_msgs/msg/GasInCell`.
            fields: The file's text.
        """
        # The parser takes every name for that of a message.
        package, _, name = kind.split("/")
        parsed = self._parse(fields, f"{package}/msg/{name}")
        constants, parts = parsed[f"{package}/msg/{name}"]
        self.store.register({kind: (constants, [(part, _without_char(field)) for part, field in parts])})

    def define_service(self, kind: str, request: str, response: str) -> None:
        """Add a service by the texts above and below the line of its `.srv` file.

        Its request and response, and the event whose type is part of the service's hash, are types of their own.

        Args:
            kind: Such as `std_srvs/srv/Trigger`.
        """
        self.define_message(f"{kind}_Request", request)
        self.define_message(f"{kind}_Response", response)
        self._register_service(kind)

    def define_action(self, kind: str, goal: str, result: str, feedback: str) -> None:
        """Add an action by the three texts of its `.action` file.

        With it come the services `<kind>_SendGoal` and `<kind>_GetResult` and the message `<kind>_FeedbackMessage` by
        which it travels, and `action_msgs/srv/CancelGoal`.

        Args:
            kind: Such as `nav2_msgs/action/NavigateToPose`.
        """
        from rosbags.interfaces import Nodetype

        def name(text: str) -> Any:
            return (Nodetype.NAME, text)

        for part, fields in (("Goal", goal), ("Result", result), ("Feedback", feedback)):
            self.define_message(f"{kind}_{part}", fields)
        if CANCEL_GOAL not in self.store.fielddefs:
            self.define_service(CANCEL_GOAL, "GoalInfo goal_info", "int8 return_code\nGoalInfo[] goals_canceling")
        goal_id = ("goal_id", name("unique_identifier_msgs/msg/UUID"))
        accepted, status = ("accepted", (Nodetype.BASE, ("bool", 0))), ("status", (Nodetype.BASE, ("int8", 0)))
        messages = {
            "SendGoal_Request": [goal_id, ("goal", name(f"{kind}_Goal"))],
            "SendGoal_Response": [accepted, ("stamp", name("builtin_interfaces/msg/Time"))],
            "GetResult_Request": [goal_id],
            "GetResult_Response": [status, ("result", name(f"{kind}_Result"))],
            "FeedbackMessage": [goal_id, ("feedback", name(f"{kind}_Feedback"))],
        }
        self.store.register({f"{kind}_{part}": ([], fields) for part, fields in messages.items()})
        for service in ("SendGoal", "GetResult"):
            self._register_service(f"{kind}_{service}")

    def _register_service(self, kind: str) -> None:
        from rosbags.interfaces import Nodetype

        if self.distribution == "humble":
            # It has neither events of services nor hashes.
            return

        def name(text: str) -> Any:
            return (Nodetype.NAME, text)

        def at_most_one(text: str) -> Any:
            return (Nodetype.SEQUENCE, (name(text), 1))

        event = [
            ("info", name("service_msgs/msg/ServiceEventInfo")),
            ("request", at_most_one(f"{kind}_Request")),
            ("response", at_most_one(f"{kind}_Response")),
        ]
        parts = [
            ("request_message", name(f"{kind}_Request")),
            ("response_message", name(f"{kind}_Response")),
            ("event_message", name(f"{kind}_Event")),
        ]
        self.store.register({f"{kind}_Event": ([], event), kind: ([], parts)})

    def hash(self, kind: str) -> str:
        """Return the hash of a message or service, RIHS01: SHA-256 of its description; a text without it for humble."""
        if self.distribution == "humble":
            return NO_HASH
        if kind not in self._hashes:
            self._hashes[kind] = self.store.hash_rihs01(kind)
        return self._hashes[kind]

    def from_cdr(self, data: bytes, kind: str) -> Any:
        """Return the message of bytes from anybody."""
        try:
            return self.store.deserialize_cdr(data, kind)
        except Exception as error:
            # The package raises of many types, and so does what it calls with lengths that the sender invents.
            raise ValueError(f"expected {kind} as CDR, was something else ({error})") from error

    def make(self, kind: str, **fields: Any) -> Any:
        """Return a message of a type such as `nav_msgs/msg/Odometry`."""
        if kind in _LATER_FIELDS and self.distribution != "humble":
            fields = {**_LATER_FIELDS[kind], **fields}
        return self.store.types[kind](**fields)

    def make_blank(self, kind: str) -> Any:
        """Return a message of a type with zeros, empty texts and empty lists."""
        from rosbags.interfaces import Nodetype

        def blank(field: Any) -> Any:
            node, rest = field
            if node == Nodetype.NAME:
                return self.make_blank(rest)
            if node == Nodetype.BASE:
                return {"string": "", "bool": False}.get(rest[0], 0)
            (of_node, of), length = rest
            if of_node == Nodetype.BASE and of[0] != "string":
                return np.zeros(length if node == Nodetype.ARRAY else 0, "uint8" if of[0] == "octet" else of[0])
            return [blank(rest[0]) for _ in range(length)] if node == Nodetype.ARRAY else []

        _, fields = self.store.fielddefs[kind]
        return self.store.types[kind](**{name: blank(field) for name, field in fields})

    def to_cdr(self, message: Any) -> bytes:
        """Return a message's bytes."""
        return bytes(self.store.serialize_cdr(message, message.__msgtype__))

    def definition(self, kind: str) -> str:
        """Return the text that defines a type, with those of the types in it."""
        return self.store.generate_msgdef(kind, ros_version=2)[0]

    def time(self, time_ns: int) -> Any:
        """Return a time."""
        sec, nanosec = divmod(time_ns, NS_PER_S)
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

    def quaternion(self, quaternion_wxyz: Vector) -> Any:
        """Return an attitude."""
        w, x, y, z = (float(value) for value in quaternion_wxyz)
        return self.make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def pose(self, position_m: Vector, quaternion_wxyz: Vector) -> Any:
        """Return a pose."""
        return self.make(
            "geometry_msgs/msg/Pose", position=self.point(position_m), orientation=self.quaternion(quaternion_wxyz)
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
                rotation=self.quaternion(quaternion_wxyz),
            ),
        )

    def cloud(
        self, time_ns: int, points: NDArray[np.float32], names: tuple[str, ...], *, frame: str = MAP_FRAME
    ) -> Any:
        """Return points as a cloud, (n, k) with a name for each of the k numbers; in the world by default."""
        fields = [
            self.make("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=_FLOAT32, count=1)
            for i, name in enumerate(names)
        ]
        step = 4 * len(names)
        return self.make(
            "sensor_msgs/msg/PointCloud2",
            header=self.header(time_ns, frame),
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
    """Return the types, made once."""
    return RosTypes()
