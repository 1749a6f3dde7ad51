"""Nav2's action NavigateToPose for an agent: a goal is a waypoint, told of until the vehicle is there."""

import math
import threading
from collections.abc import Callable, Sequence
from typing import Any

from gslcosim.base.ticks import NS_PER_S
from gslcosim.contract.messages import CommandKind
from gslcosim_ros.actions import ActionGoal, ActionServer, GoalStatus
from gslcosim_ros.node import RosNode, RosSession
from gslcosim_ros.ros_graphs import RosDistribution
from gslcosim_ros.types import MAP_FRAME, RosTypes

NAVIGATE_TO_POSE = "nav2_msgs/action/NavigateToPose"
# As near as Nav2 goes where nobody sets another tolerance.
_TOLERANCE_M = 0.25
_RESULTS: dict[RosDistribution, str] = {
    "humble": "std_msgs/Empty result",
    "jazzy": "uint16 error_code",
    "kilted": "uint16 error_code\nstring error_msg",
}
_FEEDBACK = (
    "geometry_msgs/PoseStamped current_pose\nbuiltin_interfaces/Duration navigation_time\n"
    "builtin_interfaces/Duration estimated_time_remaining\nint16 number_of_recoveries\nfloat32 distance_remaining"
)


def define_navigation(types: RosTypes) -> None:
    """Make the action's types known, as nav2_msgs of the distribution has them."""
    goal = "geometry_msgs/PoseStamped pose\nstring behavior_tree"
    types.define_action(NAVIGATE_TO_POSE, goal, _RESULTS[types.distribution], _FEEDBACK)


class Navigator:
    """Server of NavigateToPose that sends a vehicle by waypoints; a new goal takes the place of the one before.

    Attributes:
        is_flying: Whether the vehicle has got the waypoint of the present goal.

    Args:
        session: In the graph.
        node: Of the session.
        name: Of the action.
        command: Takes kind and fields of a command, on a thread of Zenoh.
    """

    def __init__(
        self, session: RosSession, node: RosNode, name: str, command: Callable[[CommandKind, dict[str, Any]], None]
    ) -> None:
        define_navigation(session.types)
        self._types = session.types
        self._command = command
        self._goal: ActionGoal | None = None
        # Goals start and are canceled on threads of Zenoh, and end on that of the agent.
        self._lock = threading.RLock()
        self._began_ns: int | None = None
        self.is_flying = False
        ActionServer(
            session, node, name, NAVIGATE_TO_POSE, self._start, accept=_is_goal_in_the_world, cancel=self._cancel
        )

    @property
    def has_goal(self) -> bool:
        """True if there is a goal that has not ended."""
        return self._goal is not None

    def observe(self, time_ns: int, pose: Any) -> None:
        """Tell how far the vehicle is, and end the goal where it has arrived.

        Args:
            pose: Of the vehicle, geometry_msgs/PoseStamped.
        """
        goal = self._goal
        if goal is None or not self.is_flying:
            return
        self._began_ns = time_ns if self._began_ns is None else self._began_ns
        distance_m = math.dist(_read_place(pose.pose), _read_place(goal.message.pose.pose))
        feedback = self._types.make_blank(f"{NAVIGATE_TO_POSE}_Feedback")
        feedback.current_pose, feedback.distance_remaining = pose, distance_m
        sec, nanosec = divmod(time_ns - self._began_ns, NS_PER_S)
        feedback.navigation_time = self._types.make("builtin_interfaces/msg/Duration", sec=sec, nanosec=nanosec)
        goal.publish_feedback(feedback)
        if distance_m <= _TOLERANCE_M:
            self._end(goal, GoalStatus.SUCCEEDED)

    def give_up(self) -> None:
        """End the present goal as one that is not reached."""
        if (goal := self._goal) is not None:
            self._end(goal, GoalStatus.ABORTED)

    def _start(self, goal: ActionGoal) -> None:
        with self._lock:
            # Somebody may have canceled it before it starts.
            if goal.status.is_end:
                return
            self.give_up()
            self._goal, self._began_ns = goal, None
            self._command("waypoint", {"position_world_m": _read_place(goal.message.pose.pose)})

    def _cancel(self, goal: ActionGoal) -> None:
        with self._lock:
            if goal is self._goal:
                self._command("hold", {})
            self._end(goal, GoalStatus.CANCELED)

    def _end(self, goal: ActionGoal, status: GoalStatus) -> None:
        with self._lock:
            if goal is self._goal:
                self._goal, self.is_flying = None, False
        goal.end(status, self._types.make_blank(f"{NAVIGATE_TO_POSE}_Result"))


def _read_place(pose: Any) -> tuple[float, float, float]:
    return pose.position.x, pose.position.y, pose.position.z


def _is_goal_in_the_world(goal: Any) -> bool:
    place: Sequence[float] = _read_place(goal.pose.pose)
    return all(math.isfinite(value) for value in place) and goal.pose.header.frame_id in ("", MAP_FRAME)
