"""Actions: goals are accepted, told of, canceled and ended, whoever vanishes meanwhile."""

import queue

import numpy as np
import pytest
from free_endpoints import find_free_endpoint

pytestmark = [pytest.mark.extras, pytest.mark.slow]
pytest.importorskip("rosbags", reason="needs the extra ros")
pytest.importorskip("xxhash", reason="needs the extra ros")
from gslcosim_ros.actions import (  # noqa: E402
    STATUS_ARRAY,
    ActionClient,
    ActionServer,
    CancelCode,
    GoalStatus,
)
from gslcosim_ros.node import RosSession  # noqa: E402
from gslcosim_ros.types import CANCEL_GOAL, RosTypes  # noqa: E402
from gslcosim_ros.wire import LATCHED  # noqa: E402

PATIENCE_S = 120.0
COUNT = "demo_msgs/action/Count"


def define(distribution="jazzy"):
    types = RosTypes(distribution)
    types.define_action(COUNT, "int32 target", "int32 reached", "int32 n")
    return types


@pytest.fixture
def count():
    """Goals that a server gets, a client of another session, what it is told, its session, and a caller of services."""
    endpoint = find_free_endpoint()
    goals, told = queue.SimpleQueue(), queue.SimpleQueue()
    with (
        RosSession.open(define(), endpoint=endpoint) as session,
        RosSession.open(define(), endpoint=endpoint) as other,
    ):
        node = session.create_node("counter")
        ActionServer(session, node, "/count", COUNT, goals.put, accept=lambda goal: goal.target > 0)
        client = ActionClient(other, other.create_node("caller"), "/count", COUNT, told.put)
        for name in ("send_goal", "cancel_goal", "get_result"):
            other.wait_for("SS", f"/count/_action/{name}", PATIENCE_S)
        session.wait_for("MS", "/count/_action/feedback", PATIENCE_S)
        yield goals, client, told, other, define()


def test_a_goal_is_accepted_told_of_and_reached(count):
    goals, client, told, other, types = count
    states = queue.SimpleQueue()
    with pytest.raises(ValueError, match="expected a goal that the server accepts, was rejected"):
        client.send_goal(types.make(f"{COUNT}_Goal", target=0), timeout_s=PATIENCE_S)
    goal_id = client.send_goal(types.make(f"{COUNT}_Goal", target=3), timeout_s=PATIENCE_S)
    goal = goals.get(timeout=PATIENCE_S)
    assert (goal.message.target, goal.goal_id, goal.is_canceling) == (3, goal_id, False)
    # It comes late, and gets the states from before.
    other.create_node("watcher").subscribe("/count/_action/status", STATUS_ARRAY, states.put, LATCHED)
    assert [each.status for each in states.get(timeout=PATIENCE_S).status_list] == [GoalStatus.EXECUTING]
    goal.publish_feedback(types.make(f"{COUNT}_Feedback", n=2))
    assert told.get(timeout=PATIENCE_S).n == 2
    goal.end(GoalStatus.SUCCEEDED, types.make(f"{COUNT}_Result", reached=3))
    goal.end(GoalStatus.ABORTED, types.make(f"{COUNT}_Result", reached=0))
    status, result = client.wait_for_result(goal_id, timeout_s=PATIENCE_S)
    assert (status, result.reached) == (GoalStatus.SUCCEEDED, 3)
    assert [each.status for each in states.get(timeout=PATIENCE_S).status_list] == [GoalStatus.SUCCEEDED]
    status, result = client.wait_for_result(b"x" * 16, timeout_s=PATIENCE_S)
    assert (status, result.reached) == (GoalStatus.UNKNOWN, 0)


def test_goals_are_canceled_by_name_by_stamp_and_all(count):
    goals, client, _, other, types = count
    assert client.cancel_goal(b"x" * 16, timeout_s=PATIENCE_S) == CancelCode.UNKNOWN_GOAL
    assert client.cancel_goal(timeout_s=PATIENCE_S) == CancelCode.REJECTED
    sent = types.make(f"{COUNT}_Goal", target=3)
    ids = [client.send_goal(sent, timeout_s=PATIENCE_S) for _ in range(3)]
    first, second, third = (goals.get(timeout=PATIENCE_S) for _ in ids)
    assert client.cancel_goal(ids[1], timeout_s=PATIENCE_S) == CancelCode.NONE
    assert (first.is_canceling, second.is_canceling, third.is_canceling) == (False, True, False)
    cancels = other.create_node("other").create_client("/count/_action/cancel_goal", CANCEL_GOAL)
    nobody = types.make("unique_identifier_msgs/msg/UUID", uuid=np.zeros(16, np.uint8))
    info = types.make("action_msgs/msg/GoalInfo", goal_id=nobody, stamp=types.time(first.accepted_ns))
    answer = cancels.call(types.make(f"{CANCEL_GOAL}_Request", goal_info=info), timeout_s=PATIENCE_S)
    assert [bytes(each.goal_id.uuid) for each in answer.goals_canceling] == [ids[0]]
    assert client.cancel_goal(timeout_s=PATIENCE_S) == CancelCode.NONE
    assert third.is_canceling
    third.end(GoalStatus.CANCELED, types.make(f"{COUNT}_Result", reached=1))
    assert client.cancel_goal(ids[2], timeout_s=PATIENCE_S) == CancelCode.ENDED


def test_a_client_that_vanishes_and_one_that_floods_hold_up_nobody(count):
    goals, client, _, _, types = count
    sent = types.make(f"{COUNT}_Goal", target=3)
    goal_id = client.send_goal(sent, timeout_s=PATIENCE_S)
    # Nobody waits for this answer any more when it comes.
    with pytest.raises(TimeoutError):
        client.wait_for_result(goal_id, timeout_s=0.01)
    for _ in range(9):
        client.send_goal(sent, timeout_s=PATIENCE_S)
    with pytest.raises(ValueError, match="was rejected"):
        client.send_goal(sent, timeout_s=PATIENCE_S)
    goals.get(timeout=PATIENCE_S).end(GoalStatus.SUCCEEDED, types.make(f"{COUNT}_Result", reached=3))
    client.send_goal(sent, timeout_s=PATIENCE_S)
    assert client.wait_for_result(goal_id, timeout_s=PATIENCE_S)[0] == GoalStatus.SUCCEEDED
