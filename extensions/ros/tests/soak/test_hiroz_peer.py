"""hiroz, a ROS 2 client in Rust that others wrote, reads and writes a run and nodes of `gslcosim_ros`.

It compiles some 270 crates, about nine minutes on two cores the first time, and is therefore a soak test.
"""

import queue
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from gslcosim.base.kernel_cache import get_cache_root

pytest.importorskip("rosbags", reason="needs the extra ros")

from gslcosim_ros import wire
from gslcosim_ros.actions import ActionGoal, ActionServer, GoalStatus
from gslcosim_ros.node import RosSession
from gslcosim_ros.types import RosTypes

pytestmark = [pytest.mark.soak, pytest.mark.skipif(shutil.which("cargo") is None, reason="needs cargo")]

PROJECT = Path(__file__).with_name("hiroz_peer")
FIBONACCI, ADD = "action_tutorials_interfaces/action/Fibonacci", "example_interfaces/srv/AddTwoInts"
BUILD_S, RUN_S = 3600, 180


@pytest.fixture(scope="module")
def peer() -> Path:
    target = get_cache_root() / "hiroz_peer"
    # Cargo writes its lock beside the manifest.
    manifest = shutil.copytree(PROJECT, get_cache_root() / "hiroz_peer_source", dirs_exist_ok=True) / "Cargo.toml"
    command = ["cargo", "build", "--quiet", "--manifest-path", str(manifest), "--target-dir", str(target)]
    built = subprocess.run(command, capture_output=True, text=True, timeout=BUILD_S, check=False)
    assert built.returncode == 0, built.stderr
    return target / "debug" / "hiroz_peer"


def test_hiroz_sees_the_graph_and_uses_topics_services_and_actions(peer: Path, tmp_path: Path) -> None:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{asked.getsockname()[1]}"
    types = RosTypes("jazzy")
    types.define_service(ADD, "int64 a\nint64 b\n", "int64 sum\n")
    types.define_action(FIBONACCI, "int32 order\n", "int32[] sequence\n", "int32[] partial_sequence\n")
    heard: queue.SimpleQueue[str] = queue.SimpleQueue()

    def start(goal: ActionGoal) -> None:
        numbers = [0, 1]
        for _ in range(goal.message.order - 1):
            numbers.append(numbers[-1] + numbers[-2])
            partial = np.array(numbers, dtype=np.int32)
            goal.publish_feedback(types.make(f"{FIBONACCI}_Feedback", partial_sequence=partial))
        result = types.make(f"{FIBONACCI}_Result", sequence=np.array(numbers, dtype=np.int32))
        goal.end(GoalStatus.SUCCEEDED, result)

    up = [str(Path(sys.executable).with_name("gslcosim")), "up", "tiny_room", "--ros2", "--pace", "1", "--runs-dir"]
    with RosSession.open(types, endpoint=endpoint) as session:
        node = session.create_node("server")
        node.answer_service("/add_two_ints", ADD, lambda asked: types.make(f"{ADD}_Response", sum=asked.a + asked.b))
        ActionServer(session, node, "/fibonacci", FIBONACCI, start)
        node.subscribe("/from_hiroz", "std_msgs/msg/String", lambda message: heard.put(message.data))
        run = subprocess.Popen(
            [*up, str(tmp_path), "--set", f"ros2.endpoint={endpoint}"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        try:
            session.wait_for(wire.PUBLISHER, "/beetle/odom", timeout_s=RUN_S)
            told = subprocess.run([peer, endpoint], capture_output=True, text=True, timeout=RUN_S, check=False)
        finally:
            run.terminate()
            run.wait(RUN_S)
    assert told.returncode == 0, told.stderr
    lines = told.stdout.splitlines()
    assert {"topic /clock rosgraph_msgs::msg::dds_::Clock_", "node / gslcosim", "sum 42", "done"} <= set(lines)
    assert "result [0, 1, 1, 2, 3, 5, 8]" in lines
    assert "feedback [0, 1, 1, 2, 3, 5]" in lines
    assert sum(line.startswith("odom map ") for line in lines) == 3
    assert heard.get(timeout=RUN_S) == "from hiroz"
