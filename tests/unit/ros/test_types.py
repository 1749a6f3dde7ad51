"""Hashes of types are those that ROS itself has, and texts define messages and services."""

import json
from pathlib import Path

import numpy as np
import pytest

from gslcosim.ros.types import RosTypes

# rosbags comes with the extra `ros`.
pytestmark = [pytest.mark.extras, pytest.mark.slow]
# From the descriptions in wheels of ROS's own packages (`share/*/msg/*.json` of ros-sensor-msgs and others): jazzy's
# common_interfaces 5.3.6, kilted's 5.5.1; of actions, from the description that rosidl has written of kilted's
# NavigateToPose, and ros-action-msgs 2.3.0.
HASHES = json.loads((Path(__file__).parent / "type_hashes.json").read_text())


@pytest.mark.parametrize("distribution", ["jazzy", "kilted"])
def test_hashes_are_those_of_ros(distribution):
    types, expected = RosTypes(distribution), HASHES[distribution]
    types.define_service("std_srvs/srv/SetBool", "bool data", "bool success\nstring message")
    types.define_service("std_srvs/srv/Trigger", "", "bool success\nstring message")
    assert {kind: types.hash(kind) for kind in expected} == expected
    assert len(expected) >= 40


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


def test_humble_has_no_hashes():
    types = RosTypes("humble")
    types.define_service("std_srvs/srv/Trigger", "", "bool success\nstring message")
    assert {types.hash(kind) for kind in ("std_msgs/msg/Float32", "std_srvs/srv/Trigger")} == {"TypeHashNotSupported"}


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
