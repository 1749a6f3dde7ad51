"""An agent that asks every socket of gslcosim that it can find for more than it may have, and logs what it has reached.

Its argument is JSON: what the test has found out for it, even the secret of the server. Each attack returns evidence
that it got through, or nothing.
"""

import contextlib
import ctypes
import json
import os
import queue
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

from raw import RawAgent

TARGETS = json.loads(sys.argv[1])
LIBRARY = ctypes.CDLL(None, use_errno=True)
EXIT_OF_ONE_THREAD = 93 if os.uname().machine == "aarch64" else 60
ANSWER_WITHIN_S = 3.0
WORDS = ["up", TARGETS["scenario"], "--runs-dir", TARGETS["outside"], "--json", "--set", "agents[0].sandbox=none"]


def _called(path):
    caller = socket.socket(socket.AF_UNIX)
    caller.settimeout(10)
    caller.connect(path)
    return caller


def _ask_for_a_run(caller):
    request = {
        "secret": TARGETS["secret"], "words": WORDS, "identity": TARGETS["identity"], "environ": TARGETS["environ"],
        "folder": "/", "umask": 0o22,
    }  # fmt: skip
    with contextlib.suppress(OSError, ValueError), caller:
        nothing = os.open(os.devnull, os.O_RDWR)
        socket.send_fds(caller, [b"gslcosim\n"], [nothing, nothing, nothing])
        caller.sendall(json.dumps(request).encode() + b"\n")
        answer = json.loads(caller.makefile().readline())
        return "" if "refused" in answer else repr(answer)
    return ""


def _by_a_child(act):
    """Let a child act, and return what it has to tell."""
    answers, tells = os.pipe()
    if os.fork() == 0:
        os.close(answers)
        with contextlib.suppress(BaseException):
            os.write(tells, act().encode())
        os._exit(0)
    os.close(tells)
    with os.fdopen(answers) as lines:
        return lines.read()


def ask_the_server_for_a_run():
    with contextlib.suppress(OSError):
        return _ask_for_a_run(_called(TARGETS["server"]))
    return ""


def ask_the_server_by_a_grandchild():
    def act():
        os.setsid()
        return _by_a_child(ask_the_server_for_a_run)

    return _by_a_child(act)


def ask_the_server_by_who_has_ended():
    with contextlib.suppress(OSError):
        caller = socket.socket(socket.AF_UNIX)
        caller.settimeout(10)
        if (child := os.fork()) == 0:
            with contextlib.suppress(OSError):
                caller.connect(TARGETS["server"])
            os._exit(0)
        os.waitpid(child, 0)
        return _ask_for_a_run(caller)
    return ""


def ask_the_server_by_a_second_thread():
    """The process's first thread has ended, so that its number shows a zombie."""

    def act():
        answers = queue.SimpleQueue()

        def later():
            while Path(f"/proc/{os.getpid()}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
                time.sleep(0.01)
            os.write(tells, ask_the_server_for_a_run().encode())
            os._exit(0)

        threading.Thread(target=later).start()
        LIBRARY.syscall(EXIT_OF_ONE_THREAD, 0)
        return answers.get()

    answers, tells = os.pipe()
    if os.fork() == 0:
        act()
    os.close(tells)
    with os.fdopen(answers) as lines:
        return lines.read()


def ask_the_server_by_our_own_command():
    environ = {**os.environ, **TARGETS["environ"]}
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        call = [sys.executable, "-m", "gslcosim", *WORDS, "--warm", "--set", "referee.stop.time_limit_s=0.1"]
        ended = subprocess.run(call, env=environ, capture_output=True, text=True, timeout=60, check=False)
        return f"exit code {ended.returncode}" if ended.stdout.startswith("{") else ""
    return ""


def read_the_secret_of_the_server():
    with contextlib.suppress(OSError):
        return Path(TARGETS["secret_file"]).read_text()[:4]
    return ""


def list_the_sockets_of_the_user():
    for folder in (TARGETS["windows"], str(Path(TARGETS["server"]).parent)):
        with contextlib.suppress(OSError):
            if names := sorted(Path(folder).iterdir()):
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


def listen_beside_the_server():
    return _listening_in(Path(TARGETS["server"]).parent, "x")


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
    ask_the_server_for_a_run, ask_the_server_by_a_grandchild, ask_the_server_by_who_has_ended,
    ask_the_server_by_a_second_thread, ask_the_server_by_our_own_command, read_the_secret_of_the_server,
    list_the_sockets_of_the_user, read_the_status_of_another_run, listen_beside_the_server, pretend_to_be_a_run,
    join_another_run, call_services_past_the_router, hear_the_truth_on_the_bus, ask_services_on_the_bus,
    join_the_ros_graph, hear_ros_on_the_bus, command_by_ros_on_the_bus, ask_the_router_for_its_configuration,
    change_what_was_verified, end_the_run,
]  # fmt: skip

if __name__ == "__main__":
    agent = RawAgent()
    agent.run_attacks(ATTACKS)
