"""An agent that asks every socket of gslcosim that it can find for more than it may have, and logs what it has reached.

Its argument is JSON: what the test has found out for it. Each attack returns evidence
that it got through, or nothing.
"""

import contextlib
import json
import queue
import socket
import sys
import time
from pathlib import Path

from raw import RawAgent

TARGETS = json.loads(sys.argv[1])
ANSWER_WITHIN_S = 3.0


def _called(path):
    caller = socket.socket(socket.AF_UNIX)
    caller.settimeout(10)
    caller.connect(path)
    return caller


def list_the_sockets_of_the_user():
    with contextlib.suppress(OSError):
        if names := sorted(Path(TARGETS["windows"]).iterdir()):
            return repr(names)
    return ""


def read_the_status_of_another_run():
    for window in TARGETS["windows_of_others"]:
        with contextlib.suppress(OSError, ValueError):
            facts = json.loads(_called(window).makefile().read())
            if "refused" not in facts:
                return f"seed {facts['seed']}"
    return ""


def _listening_in(folder, name):
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX) as listener:
        place = Path(folder, name)
        listener.bind(str(place))
        place.unlink()
        return str(place)
    return ""


def pretend_to_be_a_run():
    return _listening_in(TARGETS["windows"], "1-x.flight")


def _joined(endpoint, **changed):
    from gslcosim.base.errors import GslCosimError
    from gslcosim.bus.zenoh_bus import ZenohBus

    with contextlib.suppress(GslCosimError):
        bus = ZenohBus.open_member(agent.join.model_copy(update={"endpoint": endpoint, **changed}))
        bus.close()
        return endpoint
    return ""


def join_another_run():
    return next((found for path in TARGETS["routers"] if (found := _joined(f"unixsock-stream/{path}"))), "")


def call_services_past_the_router():
    found = (_joined(f"unixsock-stream/{path}", user=user) for path in TARGETS["meshes"] for user in USERS)
    return next((each for each in found if each), "")


def hear_the_truth_on_the_bus():
    received = queue.SimpleQueue()
    for key in ("truth/**", "referee/**", "ctl/**", "bundle/**", "**"):
        agent.bus.subscribe(key, lambda key, payload: received.put(key))
    ends_at_s = time.monotonic() + 1.0
    while (left_s := ends_at_s - time.monotonic()) > 0:
        with contextlib.suppress(queue.Empty):
            if not (key := received.get(timeout=left_s)).startswith(f"agents/{agent.join.name}/"):
                return key
    return ""


def ask_services_on_the_bus():
    answers = queue.SimpleQueue()
    for key in ("rpc/run/offer", "rpc/world/describe", "rpc/*/inspect", "rpc/world/resend", "rpc/**"):
        agent.bus.ask(key, b"", lambda key, payload: answers.put(key))
    with contextlib.suppress(queue.Empty):
        return answers.get(timeout=1.0)
    return ""


def join_the_ros_graph():
    import zenoh

    from gslcosim.base.errors import GslCosimError
    from gslcosim.bus.zenoh_bus import build_session_config, open_session

    config = build_session_config(None)
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([TARGETS["ros_endpoint"]]))
    with contextlib.suppress(GslCosimError, zenoh.ZError), open_session(config) as session:
        return next((f"router {number}" for number in session.info.routers_zid()), "")
    return ""


def hear_ros_on_the_bus():
    session, received, held = agent.bus._session, queue.SimpleQueue(), []
    for key in ("@ros2_lv/**", "0/**"):
        held.append(session.declare_subscriber(key, received.put))
        held.append(session.liveliness().declare_subscriber(key, received.put, history=True))
    with contextlib.suppress(queue.Empty):
        return str(received.get(timeout=1.0).key_expr)
    for each in held:
        each.undeclare()
    return ""


def command_by_ros_on_the_bus():
    """What the router lets pass is seen by a node outside."""
    session = agent.bus._session
    agent.forged = session.liveliness().declare_token("@ros2_lv/0/a1/0/0/NN/%/%/forged")
    session.put("0/beetle/agent/goal/forged", b"forged")
    return "sent"


def ask_the_router_for_its_configuration():
    session = agent.bus._session
    keys = [str(reply.ok.key_expr) for reply in session.get("@/**") if reply.ok is not None]
    # It answers itself, too.
    return next((key for key in keys if not key.startswith(f"@/{session.info.zid()}/")), "")


def change_what_was_verified():
    with contextlib.suppress(OSError):
        mark = Path(TARGETS["mark"])
        found = mark.read_text()
        mark.write_text(found)
        return found
    return ""


def end_the_run():
    """What the router lets pass is seen in the run's result."""
    for key in ("ctl/stop", "ctl/close", "ctl/fault", "ctl/bye/world", "referee/verdict"):
        agent.bus.publish(key, b"\x81\xa4tick\x01", urgent=True)
    agent.bus.declare_alive("alive/world")
    agent.bus.withdraw_alive("alive/world")
    return ""


USERS = ("service", "agent_beetle")
ATTACKS = [
    list_the_sockets_of_the_user, read_the_status_of_another_run, pretend_to_be_a_run,
    join_another_run, call_services_past_the_router, hear_the_truth_on_the_bus, ask_services_on_the_bus,
    join_the_ros_graph, hear_ros_on_the_bus, command_by_ros_on_the_bus, ask_the_router_for_its_configuration,
    change_what_was_verified, end_the_run,
]  # fmt: skip

if __name__ == "__main__":
    agent = RawAgent()
    agent.run_attacks(ATTACKS)
