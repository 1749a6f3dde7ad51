"""Program between a run and a ROS 2 node that decides: an agent whose decisions come by topics.

`python -m gslcosim_ros.live.agent DISTRO DOMAIN ENDPOINT [free]`, as `start: {ros2: …}` starts it. It has the
account of its agent and nothing else, so that a node can reach no more than that agent.

Below `/AGENT/agent` it publishes what the agent is given at each tick, the time of the tick as stamp: `pose`
(geometry_msgs/PoseStamped), `twist` (TwistStamped, in `map`) and `SENSOR` for each sensor with a message of its own.
After them `question` (std_msgs/Header) says that a command is awaited; its frame is what the vehicle is doing. The node
answers with the stamp of the question on one of `goal` (PoseStamped: fly there), `velocity` (TwistStamped, linear, in
`map`), `source` (PointStamped: declare it there) and `hold` (std_msgs/Header). Simulated time waits for the answer, so
that a run is repeated to the bit where the node's decisions follow from what it is told.

Nav2's action `navigate_to_pose` below the same name is another way to send the vehicle to a place: while it is under
way to a goal, nobody is asked.

In free mode it waits for nothing: commands pass when they come, whatever their stamps, and questions say only that the
vehicle is idle.
"""

import queue
import sys
import threading
from collections.abc import Callable
from typing import Any, cast

import numpy as np

from gslcosim.agent_kit import Agent, Briefing, Command, Observation, run
from gslcosim.agent_kit.agent import run_free
from gslcosim.base.frames import quaternion_from_yaw
from gslcosim.contract.messages import CommandKind, Declaration, Reading
from gslcosim.scenario.models.sensors import SensorSpec, make_sensor_spec
from gslcosim_ros.live import messages
from gslcosim_ros.live.navigation import Navigator
from gslcosim_ros.node import RosSession
from gslcosim_ros.ros_graphs import RosDistribution
from gslcosim_ros.types import MAP_FRAME, RosTypes
from gslcosim_ros.wire import CLIENT, SUBSCRIBER, QosProfile

# Where time waits, nothing that a node is told may be lost: who does not read holds up the run, as any agent that does
# not answer.
_ALL = QosProfile(depth=None)
# As long as the run itself waits for an agent, and longer.
_NODE_TIMEOUT_S = 3600.0


class RosAgent(Agent):
    """Agent whose commands come from a node of ROS 2.

    Args:
        briefing: Of the agent.
        session: In the graph.
        speak: Sends a command unasked, from any thread, in free mode; None: simulated time waits for the node.
    """

    def __init__(self, briefing: Briefing, session: RosSession, speak: Callable[[Command], None] | None = None) -> None:
        self._session, self._types, self._speak = session, session.types, speak
        self._agent = briefing.agent
        self._root = f"/{messages.topic_part(briefing.agent)}/agent"
        self._tick, self._tick_ns = 0, briefing.tick_ns
        self._qos = _ALL if speak is None else QosProfile()
        # None: the navigator has something to say.
        self._answers: queue.SimpleQueue[tuple[Any, CommandKind, dict[str, Any]] | None] = queue.SimpleQueue()
        self._navigation: queue.SimpleQueue[tuple[CommandKind, dict[str, Any]]] = queue.SimpleQueue()
        # Asked only where it has arrived or cannot go on.
        self._stops_before_question = briefing.mode == "on_request"
        self._sensors = {sensor.name: _describe_sensor(sensor.model, sensor.name) for sensor in briefing.sensors}
        node = session.create_node("agent", f"/{messages.topic_part(briefing.agent)}")
        for topic, kind, take in (
            ("goal", "geometry_msgs/msg/PoseStamped", self._take_goal),
            ("velocity", "geometry_msgs/msg/TwistStamped", self._take_velocity),
            ("source", "geometry_msgs/msg/PointStamped", self._take_source),
            ("hold", "std_msgs/msg/Header", self._take_hold),
        ):
            node.subscribe(f"{self._root}/{topic}", kind, take)
        self._node = node
        self._publishers = {
            topic: node.create_publisher(f"{self._root}/{topic}", kind, self._qos)
            for topic, kind in (
                ("pose", "geometry_msgs/msg/PoseStamped"),
                ("twist", "geometry_msgs/msg/TwistStamped"),
                ("question", "std_msgs/msg/Header"),
            )
        }
        self._is_heard = False
        # Stamp of the question that nobody has answered yet; an answer to nothing is not even kept.
        self._question: tuple[int, int] | None = None
        self._question_lock = threading.Lock()
        self._navigator = Navigator(session, node, f"{self._root}/navigate_to_pose", self._take_navigation)

    def observe(self, observation: Observation) -> None:
        """Publish what the agent is given, as soon as a node is there that can be asked."""
        self._tick = observation.tick
        if self._speak is None and not self._is_heard:
            goals = f"{self._root}/navigate_to_pose/_action/send_goal"
            self._session.wait_for_any([(SUBSCRIBER, f"{self._root}/question"), (CLIENT, goals)], _NODE_TIMEOUT_S)
            self._is_heard = True
        types, time_ns = self._types, observation.tick * self._tick_ns
        header = types.header(time_ns, MAP_FRAME)
        pose = types.pose(np.array(observation.position_world_m), quaternion_from_yaw(observation.yaw_rad))
        stamped = types.make("geometry_msgs/msg/PoseStamped", header=header, pose=pose)
        self._publishers["pose"].publish(stamped)
        twist = types.make(
            "geometry_msgs/msg/Twist",
            linear=types.vector(np.array(observation.velocity_world_m_s)),
            angular=types.vector(np.zeros(3)),
        )
        self._publishers["twist"].publish(types.make("geometry_msgs/msg/TwistStamped", header=header, twist=twist))
        for reading in observation.readings:
            if reading.values and not reading.is_warming_up:
                self._publish_reading(time_ns, reading)
        self._navigator.observe(time_ns, stamped)

    def _publish_reading(self, time_ns: int, reading: Reading) -> None:
        sensor = self._sensors.get(reading.sensor)
        if sensor is None:
            return
        values = messages.values_by_stream(reading, sensor.model)
        if (kind := messages.find_reading_type([*values], sensor)) is None:
            return
        publisher = self._publishers.get(reading.sensor)
        if publisher is None:
            topic = f"{self._root}/{messages.topic_part(reading.sensor)}"
            publisher = self._publishers[reading.sensor] = self._node.create_publisher(topic, kind, self._qos)
        publisher.publish(messages.make_reading(self._types, time_ns, self._agent, sensor, values, unit=reading.unit))

    def decide(self, observation: Observation) -> Command:
        """Ask the node, and return its answer; in free mode nothing yet."""
        stamp, noop = self._types.time(observation.tick * self._tick_ns), Command(tick=observation.tick, kind="noop")
        if self._stops_before_question and self._speak is None and self._navigator.is_flying:
            self._navigator.give_up()
        is_under_way = self._navigator.is_flying and self._speak is None
        if not is_under_way:
            with self._question_lock:
                self._question = stamp.sec, stamp.nanosec
            self._publishers["question"].publish(
                self._types.make("std_msgs/msg/Header", stamp=stamp, frame_id=observation.status)
            )
        if self._speak is not None:
            return noop
        while True:
            try:
                answer = self._answers.get(block=not is_under_way)
            except queue.Empty:
                return noop
            if answer is None and (answer := self._get_navigation(stamp)) is None:
                continue
            answered, kind, fields = answer
            # What came as the navigator answered is late now.
            if (answered.sec, answered.nanosec) == (stamp.sec, stamp.nanosec):
                with self._question_lock:
                    self._question = None
                return Command(tick=observation.tick, kind=kind, **fields)

    # The last of what the navigator has said; it answers whatever question there is.
    def _get_navigation(self, stamp: Any) -> tuple[Any, CommandKind, dict[str, Any]] | None:
        latest = None
        while not self._navigation.empty():
            latest = self._navigation.get()
        if latest is None:
            return None
        self._navigator.is_flying = self._navigator.has_goal
        return stamp, *latest

    def end(self, reason: str) -> None:
        """Leave the graph."""
        del reason
        self._navigator.give_up()
        self._session.close()

    def _take_goal(self, goal: Any) -> None:
        place = goal.pose.position
        _check_frame(goal.header)
        self._take(goal.header.stamp, "waypoint", position_world_m=_check(place.x, place.y, place.z))

    def _take_velocity(self, velocity: Any) -> None:
        v = velocity.twist.linear
        _check_frame(velocity.header)
        self._take(velocity.header.stamp, "velocity", velocity_world_m_s=_check(v.x, v.y, v.z))

    def _take_source(self, source: Any) -> None:
        place = source.point
        _check_frame(source.header)
        declaration = Declaration(position_world_m=_check(place.x, place.y, place.z))
        self._take(source.header.stamp, "declare_source", declaration=declaration)

    def _take_hold(self, header: Any) -> None:
        self._take(header.stamp, "hold")

    # On a thread of Zenoh.
    def _take(self, stamp: Any, kind: CommandKind, **fields: Any) -> None:
        if self._speak is not None:
            self._speak(Command(tick=self._tick, kind=kind, **fields))
            return
        answered = stamp.sec, stamp.nanosec
        with self._question_lock:
            asked = self._question
            if answered == asked:
                self._question = None
                self._answers.put((stamp, kind, fields))
                return
        expected = "no answer before the next question, was one with the stamp"
        if asked is not None:
            expected = f"an answer with the stamp {asked[0]}.{asked[1]:09d} of the question, was"
        self._session.report_once(
            f"{self._root}: expected {expected} {answered[0]}.{answered[1]:09d}; ignored. Copy the stamp of "
            f"{self._root}/question."
        )

    # On a thread of Zenoh.
    def _take_navigation(self, kind: CommandKind, fields: dict[str, Any]) -> None:
        if self._speak is None:
            self._navigation.put((kind, fields))
            self._answers.put(None)
        else:
            self._navigator.is_flying = self._navigator.has_goal
            self._speak(Command(tick=self._tick, kind=kind, **fields))


def _check_frame(header: Any) -> None:
    if header.frame_id not in ("", MAP_FRAME):
        raise ValueError(f"expected frame_id {MAP_FRAME} or none, was {header.frame_id[:80]!r}")


def _check(x: float, y: float, z: float) -> tuple[float, float, float]:
    if not np.isfinite([x, y, z]).all():
        raise ValueError(f"expected finite numbers, was {x:g}, {y:g}, {z:g}")
    return x, y, z


# Those that are made of readings, such as estimates, have no model of their own.
def _describe_sensor(model: str, name: str) -> SensorSpec | None:
    try:
        return make_sensor_spec(model=model, name=name)
    except ValueError:
        return None


def main() -> None:
    """Run the agents of this process with nodes of ROS 2."""
    distro, domain, endpoint, *mode = sys.argv[1:]
    types = RosTypes(cast("RosDistribution", distro))

    def open_session() -> RosSession:
        return RosSession.open(types, endpoint=endpoint, domain=int(domain))

    if mode:
        run_free(lambda briefing, speak: RosAgent(briefing, open_session(), speak))
    else:
        run(lambda briefing: RosAgent(briefing, open_session()))


if __name__ == "__main__":
    main()
