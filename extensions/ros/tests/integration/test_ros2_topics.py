"""A run as live topics of ROS 2: what its bag has, without a trace in its results."""

import json
import queue
import socket
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import yaml
from free_endpoints import find_free_endpoint

import gslcosim_data
from gslcosim.cli.main import main
from gslcosim_ros import wire
from gslcosim_ros.bag_export import iterate_messages
from gslcosim_ros.node import RosSession
from gslcosim_ros.types import RosTypes

pytestmark = [pytest.mark.extras, pytest.mark.slow]
PATIENCE_S = 60.0
SENSORS = (
    "[{model: tgs2600, name: nose}, {model: anemometer, name: wind}, {model: imu, name: imu},"
    "{model: gps, name: gps}, {model: barometer, name: barometer}, {model: magnetometer, name: compass},"
    "{model: pose, name: pose_sensor}, {model: range_finder, name: below, beam_body: [0, 0, -1]},"
    "{model: lidar_2d, name: scan, period_s: 0.2, lidar: {n_azimuths: 90}, mount_rpy_rad: [0, 0, 0.5]},"
    "{model: lidar_3d, name: cloud, period_s: 1, lidar: {n_azimuths: 30, n_elevations: 3}}]"
)
MARKERS = "visualization_msgs/msg/MarkerArray"
RVIZ = Path(__file__).parents[4] / "docs" / "examples" / "ros2" / "gslcosim.rviz"
DISPLAYED = {
    "Map": "nav_msgs/msg/OccupancyGrid",
    "Marker": "visualization_msgs/msg/Marker",
    "MarkerArray": MARKERS,
    "Odometry": "nav_msgs/msg/Odometry",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "RobotModel": "std_msgs/msg/String",
}
UP = ["up", "tiny_room", "--in-process", "--json", "--set", f"agents[0].sensors={SENSORS}"]


@pytest.fixture
def endpoint():
    return find_free_endpoint()


class Listener:
    """Subscribes to each topic that appears in the graph, so that the run publishes all it has."""

    def __init__(self, session):
        self.session, self.node = session, session.create_node("listener")
        self.messages, self.types = defaultdict(list), {}
        self._arrived, self.offered = queue.SimpleQueue(), queue.SimpleQueue()
        self._watch = session.zenoh.liveliness().declare_subscriber(
            wire.build_graph_key(0), lambda sample: self.offered.put(str(sample.key_expr))
        )

    def listen(self, topics):
        for topic, kind in topics.items():
            is_kept = topic in ("/map", "/tf_static", "/sources") or topic.endswith("/waypoints")
            qos = wire.QosProfile(is_transient_local=is_kept, depth=1000)
            self.node.subscribe(topic, kind, lambda message, topic=topic: self._arrived.put((topic, message)), qos)

    def wait_for(self, topic, is_last):
        while not self.messages[topic] or not is_last(self.messages[topic][-1]):
            arrived, message = self._arrived.get(timeout=PATIENCE_S)
            self.messages[arrived].append(message)


def fly(capsys, runs, *words):
    main([*UP, "--runs-dir", str(runs), *words])
    return json.loads(capsys.readouterr().out)


def stamp_ns(stamp):
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def test_topics_are_those_of_the_bag_and_results_the_same(endpoint, capsys, tmp_path):
    limit = ("--set", "referee.stop.time_limit_s=4")
    quiet = fly(capsys, tmp_path / "quiet", *limit)
    run = gslcosim_data.open_run(next((tmp_path / "quiet").iterdir()))
    types = RosTypes("humble")
    bag = defaultdict(list)
    for each in iterate_messages(run, types):
        bag[each.topic].append(each.message)
    # Poses of the bag are true, those of live topics are what the agent knows; points are in the vehicle's frame.
    own = {"/beetle/odom", "/beetle/pose", "/tf", "/beetle/cloud/points", "/beetle/below/points"}
    topics = {topic: found[0].__msgtype__ for topic, found in bag.items()} | {"/clock": "rosgraph_msgs/msg/Clock"}
    topics |= {"/beetle/track": MARKERS, "/truth/plume": MARKERS}
    with RosSession.open(RosTypes("jazzy"), endpoint=endpoint) as session:
        listener = Listener(session)
        listener.listen(topics)
        heard = fly(capsys, tmp_path / "live", *limit, "--ros2-truth", "--set", f"ros2.endpoint={endpoint}")
        end_ns = quiet["ticks"] * run.scenario.tick_ns
        for topic in topics:
            if topic == "/clock":
                listener.wait_for(topic, lambda last: stamp_ns(last.clock) == end_ns)
            elif topic.startswith(("/beetle/nose", "/beetle/scan")):
                listener.wait_for(topic, lambda last: stamp_ns(last.header.stamp) >= end_ns - 200_000_000)
            elif topics[topic] == MARKERS and topic != "/sources":
                listener.wait_for(topic, lambda last: stamp_ns(last.markers[0].header.stamp) >= end_ns - 1_000_000_000)
        assert_displays_are_offered(listener.offered)
    assert heard["digest"] == quiet["digest"]
    live = listener.messages
    assert set(topics) - set(live) == set()
    for topic in set(bag) - own:
        seen, kept = {_key(m): m for m in live[topic]}, {_key(m): m for m in bag[topic]}
        assert len(seen) >= len(kept) - 1, topic
        for key, message in kept.items():
            if key in seen:
                assert_equal(seen[key], message, topic)

    assert_markers_show_what_other_topics_have(live)


def assert_displays_are_offered(offered):
    """What the RViz file shows are topics of those types, kept for who comes late where it expects that."""
    displays = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]["Displays"]
    wanted = {}
    for display in displays:
        name = display["Class"].removeprefix("rviz_default_plugins/")
        if (topic := display.get("Topic") or display.get("Description Topic")) is not None:
            is_kept = topic["Durability Policy"] == "Transient Local"
            wanted[topic["Value"], DISPLAYED[name], is_kept] = display
    assert {"/beetle/track", "/truth/plume", "/map", "/beetle/robot_description"} <= {topic for topic, _, _ in wanted}
    while wanted:
        token = wire.Token.parse(offered.get(timeout=PATIENCE_S))
        if token is not None and token.kind == wire.PUBLISHER:
            is_kept = token.qos.split(":")[1] == "1"
            wanted.pop((token.name, token.type, is_kept), None)


def assert_markers_show_what_other_topics_have(live):
    poses = [message.pose.position for message in live["/beetle/pose"]]
    posed_ns = stamp_ns(live["/beetle/pose"][-1].header.stamp)
    (line,) = [m.markers for m in live["/beetle/track"] if stamp_ns(m.markers[0].header.stamp) <= posed_ns][-1]
    ends = {(point.x, point.y, point.z) for point in line.points}
    assert len(line.points) > 2
    assert ends <= {(place.x, place.y, place.z) for place in poses}
    # The last message of either topic may be the newer one: those of one instant are compared.
    clouds = {stamp_ns(message.header.stamp): message for message in live["/truth/filaments"]}
    plumes = {stamp_ns(message.markers[0].header.stamp): message.markers for message in live["/truth/plume"]}
    last_ns = max(set(clouds) & set(plumes))
    spheres, cloud = plumes[last_ns], clouds[last_ns]
    points_m = np.array([(point.x, point.y, point.z) for each in spheres for point in each.points])
    filaments_m = cloud.data.view("<f4").reshape(cloud.width, 4)
    assert len(points_m) == cloud.width > 10
    np.testing.assert_allclose(np.sort(points_m, axis=0), np.sort(filaments_m[:, :3], axis=0), atol=1e-5)
    for each in spheres:
        assert (each.action == 0) == bool(each.points)


def _key(message):
    stamp = stamp_ns(message.header.stamp) if hasattr(message, "header") else 0
    return stamp, getattr(message, "id", 0)


# A recording holds single precision; of a resistance in clean air a run knows only what it has seen.
def assert_equal(live, bag, where):
    for name, value in vars(bag).items():
        if name in ("raw_air", "__msgtype__", "header"):
            continue
        other = getattr(live, name)
        if isinstance(value, np.ndarray | float | int):
            np.testing.assert_allclose(other, value, rtol=1e-3, atol=2e-3, err_msg=f"{where}: {name}")
        elif isinstance(value, str):
            assert other == value, where
        elif hasattr(value, "__msgtype__"):
            assert_equal(other, value, where)


def test_the_truth_is_in_no_topic_unless_it_is_asked_for(endpoint, capsys, tmp_path):
    tokens = queue.SimpleQueue()
    with RosSession.open(RosTypes("humble"), endpoint=endpoint) as session:
        graph = wire.build_graph_key(0)
        with session.zenoh.liveliness().declare_subscriber(graph, lambda sample: tokens.put(str(sample.key_expr))):
            words = ("--ros2", "--ros-distro", "humble", "--set", f"ros2.endpoint={endpoint}")
            assert fly(capsys, tmp_path, *words, "--set", "referee.stop.time_limit_s=0.5")["valid"] is True
            names = set()
            while "/beetle/cloud/points" not in names:
                token = wire.Token.parse(tokens.get(timeout=PATIENCE_S))
                names.add(token.name)
                assert token.name == "" or token.type_hash == wire.NO_HASH
    assert {"/clock", "/map", "/tf", "/beetle/nose", "/beetle/scan"} <= names
    assert not [name for name in names if "truth" in name or name == "/sources"]


def test_another_program_at_the_address_is_named(capsys, tmp_path):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        assert main([*UP, "--runs-dir", str(tmp_path), "--ros2", "--set", f"ros2.endpoint=tcp/127.0.0.1:{port}"]) == 3
    said = capsys.readouterr().err
    assert "Give another endpoint, such as tcp/localhost:7448." in said
    assert ".rs:" not in said
