"""Hashes of types are those that ROS itself has, and texts define messages and services."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

Nodetype = pytest.importorskip("rosbags.interfaces", reason="needs the extra ros").Nodetype
from gslcosim_ros.simulation_interfaces import define_interfaces  # noqa: E402
from gslcosim_ros.types import RosTypes  # noqa: E402

pytestmark = [pytest.mark.extras, pytest.mark.slow]
# From the descriptions in wheels of ROS's own packages (`share/*/msg/*.json` of ros-sensor-msgs and others): jazzy's
# common_interfaces 5.3.6, kilted's 5.5.1; of actions, from the description that rosidl has written of kilted's
# NavigateToPose, and ros-action-msgs 2.3.0.
HASHES = json.loads((Path(__file__).parent / "type_hashes.json").read_text())
# Bytes that rclpy 9.1.2 of kilted has written (ros-kilted-rclpy and ros-kilted-rmw-fastrtps-cpp of PyPI, Fast CDR) of
# messages filled as `Filler` fills them.
RCLPY_MESSAGES = json.loads((Path(__file__).parent / "rclpy_messages.json").read_text())


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_hashes_are_those_of_ros(distribution):
    types, expected = RosTypes(distribution), HASHES[distribution]
    types.define_service("std_srvs/srv/SetBool", "bool data", "bool success\nstring message")
    types.define_service("std_srvs/srv/Trigger", "", "bool success\nstring message")
    assert {kind: types.hash(kind) for kind in expected} == expected
    assert len(expected) >= 40


class Filler:
    """Fills messages with a count of their values, in lists of three and texts of up to four letters."""

    def __init__(self, types):
        self.types, self.n = types, 0

    def fill(self, kind):
        _, fields = self.types.store.fielddefs[kind]
        # rclpy has no such field.
        none = {"structure_needs_at_least_one_member": 0}
        values = {name: none[name] if name in none else self.make_value(field) for name, field in fields}
        return self.types.store.types[kind](**values)

    def make_value(self, field):
        node, rest = field
        if node == Nodetype.NAME:
            return self.fill(rest)
        if node != Nodetype.BASE:
            (of_node, of), length = rest
            values = [self.make_value(rest[0]) for _ in range(length if node == Nodetype.ARRAY else 3)]
            return np.array(values, of[0]) if of_node == Nodetype.BASE and of[0] != "string" else values
        self.n += 1
        kind = rest[0]
        if kind == "bool":
            return self.n % 2 == 1
        if kind == "string":
            return "text"[: self.n % 5]
        if kind.startswith("float"):
            return self.n + 0.5
        return self.n % 100 if kind.startswith("u") else -(self.n % 100)


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_messages_have_the_bytes_of_rclpy_and_are_read_from_them(distribution):
    types = RosTypes(distribution)
    types.define_service("std_srvs/srv/SetBool", "bool data", "bool success\nstring message")
    types.define_service("std_srvs/srv/Trigger", "", "bool success\nstring message")
    types.define_action("std_srvs/action/Nothing", "", "", "")
    # Of types that are the same in both.
    known = [kind for kind in RCLPY_MESSAGES if kind not in HASHES["kilted"] or _has_one_hash(kind)]
    for kind in known:
        ours, theirs = types.to_cdr(Filler(types).fill(kind)), bytes.fromhex(RCLPY_MESSAGES[kind])
        # Fast CDR leaves what was in memory in the gaps, where we have zeros, and ends at a multiple of four bytes.
        assert len(theirs) - len(ours) in range(4), kind
        assert {own for own, other in zip(ours, theirs, strict=False) if own != other} <= {0}, kind
        assert types.to_cdr(types.from_cdr(theirs, kind)) == ours, kind
    assert len(known) >= 60


def make_plain(value):
    """Return a message as a dictionary, with lists in place of arrays."""
    if isinstance(value, list):
        return [make_plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    names = [name for name in getattr(value, "__dataclass_fields__", ()) if name != "__msgtype__"]
    return {name: make_plain(getattr(value, name)) for name in names} if names else value


@pytest.mark.parametrize("distribution", ["humble", "jazzy", "kilted"])
def test_messages_without_a_wheel_of_ros_have_the_bytes_of_another_library(distribution):
    """Texts of definitions are ours; how messages become bytes is that of mcap-ros2-support."""
    dynamic = pytest.importorskip("mcap_ros2._dynamic")
    types = RosTypes(distribution)
    define_interfaces(types)
    packages = ("simulation_interfaces", "gaden_msgs", "olfaction_msgs", "tf2_msgs")
    n_equal = 0
    for kind in [kind for kind in types.store.fielddefs if kind.startswith(packages)]:
        names = {name for name, _ in types.store.fielddefs[kind][1]}
        # What services and actions are made of has no text of its own.
        if "request_message" in names or re.search(r"_(Event|FeedbackMessage)$|_(SendGoal|GetResult)_", kind):
            continue
        message = Filler(types).fill(kind)
        writers = dynamic.serialize_dynamic(kind, types.definition(kind))
        writer = next(w for name, w in writers.items() if name.replace("/msg/", "/") == kind.replace("/msg/", "/"))
        assert bytes(writer(make_plain(message))) == types.to_cdr(message), kind
        n_equal += 1
    assert n_equal >= 35


def _has_one_hash(kind):
    return HASHES["jazzy"][kind] == HASHES["kilted"][kind]


def test_an_action_has_the_hashes_that_rosidl_gives_its_parts():
    types = RosTypes("kilted")
    types.define_action(
        "nav2_msgs/action/NavigateToPose",
        "geometry_msgs/PoseStamped pose\nstring behavior_tree",
        "uint16 error_code\nstring error_msg",
        "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
        "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining",
    )
    assert {kind: types.hash(kind) for kind in HASHES["actions"]} == HASHES["actions"]


@pytest.mark.parametrize("distribution", ["humble", "jazzy"])
def test_a_blank_message_has_zeros_and_nothing_else(distribution):
    types = RosTypes(distribution)
    for kind in ("nav_msgs/msg/Odometry", "visualization_msgs/msg/Marker", "unique_identifier_msgs/msg/UUID"):
        data = types.to_cdr(types.make_blank(kind))
        assert types.to_cdr(types.from_cdr(data, kind)) == data
    assert types.to_cdr(types.make_blank("std_msgs/msg/Header")).hex() == "00010000" + "00" * 8 + "01000000" + "00"


def test_a_service_by_text_of_nested_types_is_written_and_read():
    types = RosTypes("jazzy")
    types.define_message("gaden_msgs/msg/GasInCell", "float64[] concentration")
    types.define_service("gaden_msgs/srv/GasPosition", "float64[] x", "GasInCell[] positions\nstring[] gas_type")
    cells = [types.make("gaden_msgs/msg/GasInCell", concentration=np.array([1.0, 2.0]))]
    sent = types.make("gaden_msgs/srv/GasPosition_Response", positions=cells, gas_type=["ethanol"])
    got = types.from_cdr(types.to_cdr(sent), "gaden_msgs/srv/GasPosition_Response")
    assert ([list(cell.concentration) for cell in got.positions], got.gas_type) == ([[1.0, 2.0]], ["ethanol"])
    assert types.hash("gaden_msgs/srv/GasPosition").startswith("RIHS01_")


@pytest.mark.parametrize("data", [b"", b"\x00\x01\x00\x00", b"\x00\x01\x00\x00\xff\xff\xff\xff", bytes(100)])
def test_bytes_that_are_no_message_are_refused(data):
    with pytest.raises(ValueError, match="expected nav_msgs/msg/Odometry as CDR"):
        RosTypes("jazzy").from_cdr(data, "nav_msgs/msg/Odometry")
