"""Actions of ROS 2 over Zenoh: goals that take long, with feedback, status and a way to cancel them.

An action is three services and two topics below its name; the types of these follow from the action's own
(`RosTypes.define_action`):

    server = ActionServer(session, node, "/count", "demo_msgs/action/Count", goals.put)
    goal = goals.get()
    goal.publish_feedback(types.make("demo_msgs/action/Count_Feedback", n=1))
    goal.end(GoalStatus.SUCCEEDED, types.make("demo_msgs/action/Count_Result", n=10))

Sources: design.ros2.org/articles/actions.html, and action_msgs and rcl_action of ROS for names, policies and codes.
"""

import threading
import time
import uuid
from collections.abc import Callable
from enum import IntEnum
from typing import Any

import numpy as np

from gslcosim.base.ticks import NS_PER_S
from gslcosim_ros.node import CALL_TIMEOUT_S, RosNode, RosRequest, RosSession
from gslcosim_ros.types import CANCEL_GOAL, RosTypes
from gslcosim_ros.wire import LATCHED

STATUS_ARRAY = "action_msgs/msg/GoalStatusArray"
_UUID = "unique_identifier_msgs/msg/UUID"
# Of goals that go on, for each is work; of those that are over, for who asks late.
_MAX_GOALS = 10
_MAX_ENDED_GOALS = 100


class GoalStatus(IntEnum):
    """States of a goal, as `action_msgs/msg/GoalStatus` has them."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6

    @property
    def is_end(self) -> bool:
        """True if a goal stays in this state."""
        return self >= GoalStatus.SUCCEEDED


class CancelCode(IntEnum):
    """Answers to a request to cancel goals, as `action_msgs/srv/CancelGoal` has them."""

    NONE = 0
    REJECTED = 1
    UNKNOWN_GOAL = 2
    ENDED = 3


class ActionGoal:
    """Goal that a server has accepted.

    Attributes:
        message: Of the type `<kind>_Goal`.
        status: Its present state.
    """

    def __init__(self, server: "ActionServer", goal_id: bytes, message: Any) -> None:
        self.message = message
        self.status = GoalStatus.EXECUTING
        self.goal_id = goal_id
        self.accepted_ns = time.time_ns()
        self.result: Any = None
        # Requests for the result that came before it.
        self.waiting: list[RosRequest] = []
        self._server = server

    @property
    def is_canceling(self) -> bool:
        """True if somebody wants it to end before it is reached."""
        return self.status == GoalStatus.CANCELING

    def publish_feedback(self, feedback: Any) -> None:
        """Publish a message `<kind>_Feedback` about the goal."""
        self._server.publish_feedback(self, feedback)

    def end(self, status: GoalStatus, result: Any) -> None:
        """End the goal; without effect where it has ended.

        Args:
            status: Succeeded, canceled or aborted.
            result: A message `<kind>_Result`.
        """
        self._server.end_goal(self, status, result)


class ActionServer:
    """Server of an action.

    A client that vanishes changes nothing: its goal goes on until it ends or somebody cancels it.

    Args:
        session: In the graph, whose types know the action.
        node: Of the session.
        name: Such as `/navigate_to_pose`.
        kind: Type of the action, such as `nav2_msgs/action/NavigateToPose`.
        start: Receives each accepted goal, on a thread of Zenoh, and returns soon; it or others end the goal.
        accept: Returns whether a message `<kind>_Goal` is accepted; absent: all are. With more goals at once than ten
            none is.
        cancel: Receives a goal whose state has become canceling, and returns soon.
    """

    def __init__(
        self,
        session: RosSession,
        node: RosNode,
        name: str,
        kind: str,
        start: Callable[[ActionGoal], None],
        *,
        accept: Callable[[Any], bool] = lambda _: True,
        cancel: Callable[[ActionGoal], None] = lambda _: None,
    ) -> None:
        self._types = session.types
        self._kind = kind
        self._start, self._accept, self._cancel = start, accept, cancel
        self._goals: dict[bytes, ActionGoal] = {}
        self._lock = threading.RLock()
        root = f"{name}/_action"
        self._feedback = node.create_publisher(f"{root}/feedback", f"{kind}_FeedbackMessage")
        self._status = node.create_publisher(f"{root}/status", STATUS_ARRAY, LATCHED)
        node.take_requests(f"{root}/send_goal", f"{kind}_SendGoal", self._take_goal)
        node.answer_service(f"{root}/cancel_goal", CANCEL_GOAL, self._cancel_goals)
        node.take_requests(f"{root}/get_result", f"{kind}_GetResult", self._take_result_request)

    def publish_feedback(self, goal: ActionGoal, feedback: Any) -> None:
        """Publish feedback about a goal; see `ActionGoal.publish_feedback`."""
        goal_id = _make_goal_id(self._types, goal.goal_id)
        self._feedback.publish(self._types.make(f"{self._kind}_FeedbackMessage", goal_id=goal_id, feedback=feedback))

    def end_goal(self, goal: ActionGoal, status: GoalStatus, result: Any) -> None:
        """End a goal; see `ActionGoal.end`."""
        with self._lock:
            if goal.status.is_end:
                return
            goal.status, goal.result = status, result
            waiting, goal.waiting = goal.waiting, []
            ended = [goal_id for goal_id, each in self._goals.items() if each.status.is_end]
            for goal_id in ended[:-_MAX_ENDED_GOALS]:
                del self._goals[goal_id]
            self._publish_status()
        for request in waiting:
            self._answer_result(request, status, result)

    def _take_goal(self, request: RosRequest) -> None:
        message, types = request.message, self._types
        goal = ActionGoal(self, bytes(message.goal_id.uuid), message.goal)
        with self._lock:
            n_active = sum(not each.status.is_end for each in self._goals.values())
            is_new = goal.goal_id not in self._goals and n_active < _MAX_GOALS
            is_accepted = is_new and self._accept(message.goal)
            if is_accepted:
                self._goals[goal.goal_id] = goal
        stamp = types.time(goal.accepted_ns)
        request.answer(types.to_cdr(types.make(f"{self._kind}_SendGoal_Response", accepted=is_accepted, stamp=stamp)))
        if is_accepted:
            with self._lock:
                self._publish_status()
            self._start(goal)

    def _take_result_request(self, request: RosRequest) -> None:
        with self._lock:
            goal = self._goals.get(bytes(request.message.goal_id.uuid))
            if goal is not None and not goal.status.is_end:
                goal.waiting.append(request)
                return
        if goal is None:
            self._answer_result(request, GoalStatus.UNKNOWN, self._types.make_blank(f"{self._kind}_Result"))
        else:
            self._answer_result(request, goal.status, goal.result)

    def _answer_result(self, request: RosRequest, status: GoalStatus, result: Any) -> None:
        types = self._types
        response = types.make(f"{self._kind}_GetResult_Response", status=int(status), result=result)
        request.answer(types.to_cdr(response))

    # An identifier names one goal, a stamp all that were accepted until then, and neither of them all goals.
    def _cancel_goals(self, request: Any) -> Any:
        goal_id = bytes(request.goal_info.goal_id.uuid)
        stamp = request.goal_info.stamp
        until_ns = stamp.sec * NS_PER_S + stamp.nanosec
        is_of_all = not any(goal_id) and not until_ns
        with self._lock:
            named = self._goals.get(goal_id)
            chosen = [
                goal
                for goal in self._goals.values()
                if not goal.status.is_end and (goal is named or is_of_all or goal.accepted_ns <= until_ns)
            ]
            for goal in chosen:
                goal.status = GoalStatus.CANCELING
            if chosen:
                self._publish_status()
        for goal in chosen:
            self._cancel(goal)
        code = CancelCode.NONE
        if not chosen:
            code = CancelCode.REJECTED if not any(goal_id) else CancelCode.UNKNOWN_GOAL
            code = code if named is None else CancelCode.ENDED
        return self._types.make(
            f"{CANCEL_GOAL}_Response",
            return_code=int(code),
            goals_canceling=[self._make_info(goal) for goal in chosen],
        )

    def _publish_status(self) -> None:
        make = self._types.make
        goals = [
            make("action_msgs/msg/GoalStatus", goal_info=self._make_info(goal), status=int(goal.status))
            for goal in self._goals.values()
        ]
        self._status.publish(make(STATUS_ARRAY, status_list=goals))

    def _make_info(self, goal: ActionGoal) -> Any:
        return _make_goal_info(self._types, goal.goal_id, goal.accepted_ns)


class ActionClient:
    """Client of an action.

    Args:
        session: In the graph, whose types know the action.
        node: Of the session.
        name: Such as `/navigate_to_pose`.
        kind: Type of the action.
        on_feedback: Receives the messages `<kind>_Feedback` about goals of this client, on a thread of Zenoh.
    """

    def __init__(
        self,
        session: RosSession,
        node: RosNode,
        name: str,
        kind: str,
        on_feedback: Callable[[Any], None] = lambda _: None,
    ) -> None:
        self._types = session.types
        self._kind = kind
        self._own: set[bytes] = set()
        root = f"{name}/_action"
        self._goals = node.create_client(f"{root}/send_goal", f"{kind}_SendGoal")
        self._cancels = node.create_client(f"{root}/cancel_goal", CANCEL_GOAL)
        self._results = node.create_client(f"{root}/get_result", f"{kind}_GetResult")

        def take(message: Any) -> None:
            if bytes(message.goal_id.uuid) in self._own:
                on_feedback(message.feedback)

        node.subscribe(f"{root}/feedback", f"{kind}_FeedbackMessage", take)

    def send_goal(self, goal: Any, *, timeout_s: float = CALL_TIMEOUT_S) -> bytes:
        """Send a message `<kind>_Goal`, and return the identifier of the accepted goal."""
        goal_id = uuid.uuid4().bytes
        self._own.add(goal_id)
        named = _make_goal_id(self._types, goal_id)
        request = self._types.make(f"{self._kind}_SendGoal_Request", goal_id=named, goal=goal)
        if not self._goals.call(request, timeout_s=timeout_s).accepted:
            self._own.discard(goal_id)
            raise ValueError(f"{self._kind}: expected a goal that the server accepts, was rejected")
        return goal_id

    def wait_for_result(self, goal_id: bytes, *, timeout_s: float = CALL_TIMEOUT_S) -> tuple[GoalStatus, Any]:
        """Return how a goal has ended, and its message `<kind>_Result`; unknown goals have status UNKNOWN."""
        request = self._types.make(f"{self._kind}_GetResult_Request", goal_id=_make_goal_id(self._types, goal_id))
        response = self._results.call(request, timeout_s=timeout_s)
        return GoalStatus(response.status), response.result

    def cancel_goal(self, goal_id: bytes = bytes(16), *, timeout_s: float = CALL_TIMEOUT_S) -> CancelCode:
        """Ask the server to cancel a goal, by default all of all clients."""
        types = self._types
        request = types.make(f"{CANCEL_GOAL}_Request", goal_info=_make_goal_info(types, goal_id, 0))
        return CancelCode(self._cancels.call(request, timeout_s=timeout_s).return_code)


def _make_goal_id(types: RosTypes, goal_id: bytes) -> Any:
    return types.make(_UUID, uuid=np.frombuffer(goal_id, np.uint8))


def _make_goal_info(types: RosTypes, goal_id: bytes, accepted_ns: int) -> Any:
    stamp = types.time(accepted_ns)
    return types.make("action_msgs/msg/GoalInfo", goal_id=_make_goal_id(types, goal_id), stamp=stamp)
