"""A node of ROS 2 decides for an agent, as the same rule does in Python."""

import queue
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from deadlines import EVENT_S
from free_endpoints import find_free_endpoint
from real_runs import TINY_ROOM, fly, fly_command, start

from gslcosim_ros.actions import ActionClient, CancelCode, GoalStatus
from gslcosim_ros.live.navigation import NAVIGATE_TO_POSE, define_navigation
from gslcosim_ros.node import RosSession
from gslcosim_ros.types import RosTypes
from gslcosim_ros.wire import LATCHED

sys.path.append(str(Path(__file__).with_name("agents")))
from ros_twin import choose_target

AGENTS = Path(__file__).with_name("agents")
pytestmark = [pytest.mark.end_to_end, pytest.mark.extras, pytest.mark.slow]
LOCKSTEP = ("--set", "agents[0].mode=lockstep", "--set", "referee.stop.time_limit_s=3")
PREFIX = "/beetle/agent"


class Node:
    """Answers each question by the rule, once the readings of its tick are there, after answers that are none."""

    def __init__(self, session, goal_type="geometry_msgs/msg/PoseStamped"):
        self.types, self.told = session.types, queue.SimpleQueue()
        node = session.create_node("searcher")
        self.goals = node.create_publisher(f"{PREFIX}/goal", goal_type)
        for topic, kind in (("pose", "geometry_msgs/msg/PoseStamped"), ("nose", "olfaction_msgs/msg/GasSensor")):
            node.subscribe(f"{PREFIX}/{topic}", kind, lambda got, topic=topic: self.told.put((topic, got)))
        # Last: the run begins when somebody hears the question.
        node.subscribe(f"{PREFIX}/question", "std_msgs/msg/Header", lambda got: self.told.put(("question", got)))

    def answer_all(self):
        known = {}
        while (told := self.told.get()) is not None:
            topic, got = told
            known[topic] = got
            if len(known) != 3 or len({self.stamp(topic, got) for topic, got in known.items()}) != 1:
                continue
            self.send(float("nan"), 0.0, 0.0, known["question"].stamp)
            self.send(0.0, 0.0, 0.0, self.types.time(1))
            self.send(0.0, 0.0, 0.0, known["question"].stamp, "beetle/base_link")
            place = known["pose"].pose.position
            target_m = choose_target((place.x, place.y, place.z), known["nose"].raw)
            self.send(*target_m, known["question"].stamp)
            # Too late: this tick has its answer.
            self.send(0.0, 0.0, 0.0, known["question"].stamp)
            del known["question"]

    def send(self, x, y, z, stamp, frame="map"):
        types = self.types
        pose = types.make(
            "geometry_msgs/msg/Pose",
            position=types.make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=types.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        )
        header = types.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)
        self.goals.publish(types.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose))

    @staticmethod
    def stamp(topic, got):
        stamp = got.stamp if topic == "question" else got.header.stamp
        return stamp.sec, stamp.nanosec


def test_a_node_in_lockstep_flies_as_the_same_rule_in_python(tmp_path):
    native = fly(TINY_ROOM, tmp_path / "native", *LOCKSTEP, "--set", f"agents[0].start.python={AGENTS / 'ros_twin.py'}")
    assert native.result["valid"] is True, native.errors
    endpoint = find_free_endpoint()
    with RosSession.open(RosTypes("jazzy"), endpoint=endpoint) as session:
        node, start_by = Node(session), f"agents[0].start={{ros2: {{endpoint: '{endpoint}'}}}}"
        flight = start(TINY_ROOM, tmp_path / "ros", *LOCKSTEP, "--set", start_by)
        answering = threading.Thread(target=node.answer_all)
        answering.start()
        try:
            ended = flight.end()
        finally:
            node.told.put(None)
            answering.join()
    assert ended.result["valid"] is True, ended.errors
    assert ended.result["digest"] == native.result["digest"]
    log = (ended.run_dir / "logs" / "agent_beetle.log").read_text()
    assert "/beetle/agent/goal: expected finite numbers, was nan, 0, 0; ignored." in log
    assert "/beetle/agent/goal: expected frame_id map or none, was 'beetle/base_link'; ignored." in log
    assert "of the question, was 0.000000001; ignored. Copy the stamp of /beetle/agent/question." in log


READER = """
import sys, threading
from gslcosim_ros.actions import ActionClient, CancelCode, GoalStatus
from gslcosim_ros.node import RosSession
from gslcosim_ros.types import RosTypes
with RosSession.open(RosTypes("kilted"), endpoint=sys.argv[1]) as session:
    session.create_node("reader").subscribe("/beetle/odom", "nav_msgs/msg/Odometry", lambda _: None)
    threading.Event().wait()
"""


class Pilot:
    """Answers by velocity and hold, by turns of a second; at some questions it first does something else."""

    def __init__(self, session, deeds):
        self.types, self.questions, self._deeds = session.types, queue.SimpleQueue(), deeds
        node = session.create_node("pilot")
        self._velocities = node.create_publisher(f"{PREFIX}/velocity", "geometry_msgs/msg/TwistStamped")
        self._holds = node.create_publisher(f"{PREFIX}/hold", "std_msgs/msg/Header")
        self.speeds_m_s = []
        node.subscribe(f"{PREFIX}/twist", "geometry_msgs/msg/TwistStamped", self._take_twist)
        node.subscribe(f"{PREFIX}/question", "std_msgs/msg/Header", self.questions.put)

    def _take_twist(self, twist):
        self.speeds_m_s.append(abs(twist.twist.linear.x))

    def answer_all(self):
        types, n_answers = self.types, 0
        while (question := self.questions.get()) is not None:
            self._deeds.pop(n_answers, lambda: None)()
            header = types.make("std_msgs/msg/Header", stamp=question.stamp, frame_id="map")
            if n_answers % 20 < 10:
                twist = types.make_blank("geometry_msgs/msg/Twist")
                twist.linear.x = -0.4
                self._velocities.publish(types.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist))
            else:
                self._holds.publish(header)
            n_answers += 1


def test_a_run_of_kilted_serves_who_comes_late_and_outlives_who_stops_reading(tmp_path):
    endpoint = find_free_endpoint()
    late, unanswered = queue.SimpleQueue(), []
    with (
        RosSession.open(RosTypes("kilted"), endpoint=endpoint) as session,
        subprocess.Popen([sys.executable, "-c", READER, endpoint]) as reader,
    ):
        types = session.types
        types.define_service("std_srvs/srv/SetBool", "bool data", "bool success\nstring message")

        def come_late():
            node = session.create_node("late")
            for topic, kind in (
                ("/map", "nav_msgs/msg/OccupancyGrid"),
                ("/tf_static", "tf2_msgs/msg/TFMessage"),
                ("/beetle/robot_description", "std_msgs/msg/String"),
            ):
                node.subscribe(topic, kind, lambda got, topic=topic: late.put((topic, got)), LATCHED)

        def ask_nobody():
            client = session.create_node("lost").create_client("/nobody", "std_srvs/srv/SetBool")
            with pytest.raises(TimeoutError):
                client.call(types.make("std_srvs/srv/SetBool_Request", data=True), timeout_s=1.0)
            unanswered.append("/nobody")

        deeds = {5: lambda: reader.send_signal(signal.SIGSTOP), 10: come_late, 15: ask_nobody, 20: reader.kill}
        try:
            session.wait_for("MS", "/beetle/odom", EVENT_S)
            pilot = Pilot(session, deeds)
            start_by = f"agents[0].start={{ros2: {{distro: kilted, endpoint: '{endpoint}'}}}}"
            graph = ("--ros-distro", "kilted", "--set", f"ros2.endpoint={endpoint}")
            limit = ("--set", "agents[0].mode=lockstep", "--set", "referee.stop.time_limit_s=8")
            flight = start(TINY_ROOM, tmp_path, *limit, *graph, "--set", start_by)
            answering = threading.Thread(target=pilot.answer_all)
            answering.start()
            try:
                ended = flight.end()
            finally:
                pilot.questions.put(None)
                answering.join()
        finally:
            reader.kill()
        kept = dict(late.get(timeout=EVENT_S) for _ in range(3))
    assert ended.result["valid"] is True, ended.errors
    assert (unanswered, deeds) == (["/nobody"], {})
    first_fast = next(i for i, speed_m_s in enumerate(pilot.speeds_m_s) if speed_m_s > 0.2)
    assert min(pilot.speeds_m_s[first_fast:]) < 0.2
    assert (kept["/map"].info.width > 0, len(kept["/tf_static"].transforms)) == (True, 2)
    assert '<link name="beetle/base_link">' in kept["/beetle/robot_description"].data


class FreePilot:
    """Flies to the west at each pose, holds when it has come far enough, and declares the source when it stands."""

    def __init__(self, session):
        self.types, self.is_far = session.types, False
        node = session.create_node("pilot")
        self._topics = {
            topic: node.create_publisher(f"{PREFIX}/{topic}", kind)
            for topic, kind in (
                ("velocity", "geometry_msgs/msg/TwistStamped"),
                ("hold", "std_msgs/msg/Header"),
                ("source", "geometry_msgs/msg/PointStamped"),
            )
        }
        node.subscribe(f"{PREFIX}/twist", "geometry_msgs/msg/TwistStamped", self._take_twist)
        node.subscribe(f"{PREFIX}/pose", "geometry_msgs/msg/PoseStamped", self._take_pose)

    def _take_pose(self, pose):
        self.is_far = self.is_far or pose.pose.position.x < 4.2
        message = self.types.make_blank("geometry_msgs/msg/TwistStamped")
        message.twist.linear.x = -0.4
        self._topics["hold" if self.is_far else "velocity"].publish(message.header if self.is_far else message)

    def _take_twist(self, twist):
        if self.is_far and abs(twist.twist.linear.x) < 0.05:
            message = self.types.make_blank("geometry_msgs/msg/PointStamped")
            message.point.x, message.point.y, message.point.z = 1.5, 2.0, 1.0
            self._topics["source"].publish(message)


def test_a_node_commands_a_run_that_does_not_wait(tmp_path):
    endpoint = find_free_endpoint()
    free = ("agents[0].mode=free", "pace=5", "referee.stop.time_limit_s=3600")
    success = "referee.success={of: declaration, within_m: 0.5}"
    words = [word for value in (*free, success) for word in ("--set", value)]
    with RosSession.open(RosTypes("jazzy"), endpoint=endpoint) as session:
        pilot = FreePilot(session)
        start_by = f"agents[0].start={{ros2: {{endpoint: '{endpoint}'}}}}"
        ended = fly_command(TINY_ROOM, tmp_path, *words, "--set", start_by)
    assert (ended.result["valid"], ended.result["agents"][0]["success"]) == (True, True), ended.errors
    assert pilot.is_far


def test_goals_of_nav2_send_the_vehicle_on(tmp_path):
    endpoint = find_free_endpoint()
    types, told = RosTypes("kilted"), queue.SimpleQueue()
    define_navigation(types)
    with RosSession.open(types, endpoint=endpoint) as session:
        path = f"{PREFIX}/navigate_to_pose"
        client = ActionClient(session, session.create_node("caller"), path, NAVIGATE_TO_POSE, told.put)
        start_by = f"agents[0].start={{ros2: {{distro: kilted, endpoint: '{endpoint}'}}}}"
        flight = start(TINY_ROOM, tmp_path, "--set", start_by, "--set", "agents[0].answer_within_s=300")
        session.wait_for("SS", f"{path}/_action/get_result", EVENT_S)

        def send(x, y):
            goal = types.make_blank(f"{NAVIGATE_TO_POSE}_Goal")
            goal.pose.pose.position.x, goal.pose.pose.position.y, goal.pose.pose.position.z = x, y, 1.0
            return client.send_goal(goal, timeout_s=EVENT_S)

        with pytest.raises(ValueError, match="was rejected"):
            send(float("nan"), 2.5)
        canceled = send(4.5, 4.5)
        assert client.cancel_goal(canceled, timeout_s=EVENT_S) == CancelCode.NONE
        assert client.wait_for_result(canceled, timeout_s=EVENT_S)[0] == GoalStatus.CANCELED
        assert client.wait_for_result(send(3.5, 2.5), timeout_s=EVENT_S)[0] == GoalStatus.SUCCEEDED
        send(1.8, 2.0)
        ended = flight.end()
    assert (ended.result["valid"], ended.result["agents"][0]["success"]) == (True, True), ended.errors
    left_m = [told.get().distance_remaining for _ in range(told.qsize())]
    assert max(left_m) > 0.9
    assert min(left_m) < 0.25
