"""A node of ROS 2 decides for an agent, as the same rule does in Python."""

import queue
import socket
import sys
import threading

import pytest
from real_runs import AGENTS, TINY_ROOM, fly, start

from gslcosim.ros.node import RosSession
from gslcosim.ros.types import RosTypes

sys.path.append(str(AGENTS))
from ros_twin import choose_target

# xxhash and rosbags come with the extra `ros`.
pytestmark = [pytest.mark.end_to_end, pytest.mark.extras, pytest.mark.slow]
LOCKSTEP = ("--set", "agents[0].mode=lockstep", "--set", "referee.stop.time_limit_s=3")
PREFIX = "/beetle/agent"


class Node:
    """Answers each question by the rule, once the readings of its tick are there, after two answers that are none."""

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
            place = known["pose"].pose.position
            target_m = choose_target((place.x, place.y, place.z), known["nose"].raw)
            self.send(*target_m, known["question"].stamp)
            del known["question"]

    def send(self, x, y, z, stamp):
        types = self.types
        pose = types.make(
            "geometry_msgs/msg/Pose",
            position=types.make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=types.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0),
        )
        header = types.make("std_msgs/msg/Header", stamp=stamp, frame_id="map")
        self.goals.publish(types.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose))

    @staticmethod
    def stamp(topic, got):
        stamp = got.stamp if topic == "question" else got.header.stamp
        return stamp.sec, stamp.nanosec


def test_a_node_in_lockstep_flies_as_the_same_rule_in_python(tmp_path):
    native = fly(TINY_ROOM, tmp_path / "native", *LOCKSTEP, "--set", f"agents[0].start.python={AGENTS / 'ros_twin.py'}")
    assert native.result["valid"] is True, native.errors
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
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
    assert "of the question, was 0.000000001; ignored. Copy the stamp of /beetle/agent/question." in log
