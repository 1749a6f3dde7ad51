"""Nodes meet those of another session, and those of a package that others wrote."""

import gc
import queue
import socket
import weakref
from contextlib import ExitStack

import pytest

from gslcosim_ros import wire
from gslcosim_ros.node import RosSession
from gslcosim_ros.ros_graphs import ROS_DISTRIBUTIONS
from gslcosim_ros.types import RosTypes

# Longer than a busy machine takes.
PATIENCE_S = 60.0
FLOAT32, TRIGGER = "std_msgs/msg/Float32", "std_srvs/srv/SetBool"
TRIGGER_FIELDS = ("bool data", "bool success\nstring message")
pytestmark = [pytest.mark.extras, pytest.mark.slow]


@pytest.fixture
def port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@pytest.fixture
def reports():
    return queue.SimpleQueue()


@pytest.fixture
def open_session(port, reports):
    with ExitStack() as stack:

        def open_one(distribution="jazzy"):
            types = RosTypes(distribution)
            types.define_service(TRIGGER, *TRIGGER_FIELDS)
            return stack.enter_context(RosSession.open(types, endpoint=f"tcp/127.0.0.1:{port}", report=reports.put))

        yield open_one


def test_a_node_that_nobody_holds_stays_in_the_graph_until_it_is_closed(open_session):
    ours = open_session()
    gone = weakref.ref(ours.create_node("gslcosim"))
    publisher = gone().create_publisher("/gas", FLOAT32)
    gc.collect()
    assert open_session().wait_for("MP", publisher.topic, PATIENCE_S).node == "gslcosim"
    gone().close()
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize("distribution", ROS_DISTRIBUTIONS)
def test_two_sessions_exchange_messages_and_answers(open_session, distribution):
    ours, theirs = open_session(distribution), open_session(distribution)
    types, node, peer = ours.types, ours.create_node("gslcosim"), theirs.create_node("rviz", "/screen")
    gas, arrived = node.create_publisher("/map", FLOAT32, wire.LATCHED), queue.SimpleQueue()
    gas.publish(types.make(FLOAT32, data=1.5))
    # It comes late, and gets what was published before.
    peer.subscribe("/map", FLOAT32, arrived.put, wire.LATCHED)
    assert arrived.get(timeout=PATIENCE_S).data == 1.5

    def answer(request):
        if not request.data:
            raise ValueError("expected true, was false")
        return types.make(f"{TRIGGER}_Response", success=True, message="done")

    node.answer_service("/set", TRIGGER, answer)
    client = peer.create_client("/set", TRIGGER)
    for session, kind, name in (
        (theirs, "MP", "/map"),
        (theirs, "SS", "/set"),
        (ours, "MS", "/map"),
        (ours, "SC", "/set"),
    ):
        session.wait_for(kind, name, PATIENCE_S)
    assert {(t.kind, t.node, t.name) for t in ours.graph} == {
        ("NN", "gslcosim", ""), ("MP", "gslcosim", "/map"), ("SS", "gslcosim", "/set"),
        ("NN", "rviz", ""), ("MS", "rviz", "/map"), ("SC", "rviz", "/set"),
    }  # fmt: skip
    assert {t.type_hash for t in ours.graph if t.name == "/map"} == {types.hash(FLOAT32)}
    assert client.call(types.make(f"{TRIGGER}_Request", data=True), timeout_s=PATIENCE_S).message == "done"
    with pytest.raises(ValueError, match="expected true, was false"):
        client.call(types.make(f"{TRIGGER}_Request", data=False), timeout_s=PATIENCE_S)


def test_nonsense_is_reported_and_the_next_message_arrives(open_session, reports):
    ours, theirs = open_session(), open_session()
    arrived = queue.SimpleQueue()
    ours.create_node("gslcosim").subscribe("/goal", FLOAT32, arrived.put, max_bytes=1000)
    writer = theirs.create_node("rviz").create_publisher("/goal", FLOAT32, wire.QosProfile(depth=None))
    theirs.wait_for("MS", "/goal", PATIENCE_S)
    for data in (b"", b"\x00\x01\x00\x00\x00", bytes(2000)):
        writer.publish_cdr(data)
    writer.publish(theirs.types.make(FLOAT32, data=2.5))
    assert arrived.get(timeout=PATIENCE_S).data == 2.5
    said = [reports.get(timeout=PATIENCE_S) for _ in range(3)]
    assert sum("/goal: expected std_msgs/msg/Float32 as CDR" in each for each in said) == 2
    assert any("expected a message of at most 1000 bytes, was 2000 bytes; ignored." in each for each in said)
    # Another distribution's type, or another type of that name.
    theirs.create_node("old\x1b[2J\n" + "y" * 9000).create_publisher("/goal", "std_msgs/msg/Int32")
    both = [reports.get(timeout=PATIENCE_S) for _ in range(2)]
    assert any("node old?[2J?yyy" in each for each in both)
    assert max(len(each) for each in both) == 1000


def test_a_package_of_others_reads_and_writes_us(open_session, port):
    sdk = pytest.importorskip("zenoh_ros2_sdk", reason="needs zenoh-ros2-sdk, of test-all")
    qos = pytest.importorskip("zenoh_ros2_sdk.qos")
    ours = open_session()
    types, node, arrived = ours.types, ours.create_node("gslcosim"), queue.SimpleQueue()
    assert types.to_cdr(types.make(FLOAT32, data=1.5)).hex() == "000100000000c03f"
    node.create_publisher("/map", FLOAT32, wire.LATCHED).publish(types.make(FLOAT32, data=1.5))
    node.answer_service(
        "/set", TRIGGER, lambda asked: types.make(f"{TRIGGER}_Response", success=asked.data, message="é")
    )
    node.subscribe("/wind", FLOAT32, arrived.put)
    peer = {"router_ip": "127.0.0.1", "router_port": port}
    of_float = {**peer, "msg_definition": "float32 data"}
    latched = qos.QosProfile(durability=qos.QosDurability.TRANSIENT_LOCAL)
    heard = queue.SimpleQueue()
    try:
        sdk.ROS2Subscriber("/map", FLOAT32, heard.put, qos=latched, **of_float)
        assert heard.get(timeout=PATIENCE_S).data == 1.5
        writer = sdk.ROS2Publisher("/wind", FLOAT32, **of_float)
        ours.wait_for("MP", "/wind", PATIENCE_S)
        writer.publish(data=3.5)
        assert arrived.get(timeout=PATIENCE_S).data == 3.5
        client = sdk.ROS2ServiceClient(
            "/set", TRIGGER, request_definition=TRIGGER_FIELDS[0], response_definition=TRIGGER_FIELDS[1],
            timeout=PATIENCE_S, **peer,
        )  # fmt: skip
        response = client.call(data=True)
        assert (response.success, response.message) == (True, "é")
        seen = {
            info.node_name for info in sdk.get_topic_info("/map", timeout=PATIENCE_S, verbose=True, **peer).publishers
        }
        assert seen == {"gslcosim"}
    finally:
        sdk.ZenohSession.get_instance(**peer).close()
