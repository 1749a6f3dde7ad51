"""Agents that ask the sockets of gslcosim for more than they may have, beside two other runs.

`make attacks` prints the table of attacks and sandboxes; it stands in docs/reliability.md.
"""

import json
import re
import shutil
import socket
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest
from crowd import crowded
from ordinary_user import run_tests_as_ordinary_user
from real_runs import AGENTS, ROOT, TINY_ROOM, fly_command

from gslcosim.base.files import user_state_folder
from gslcosim.runtime.processes.sandbox.selection import unavailable_reason
from gslcosim.runtime.status import get_status_folder, list_active_runs

pytestmark = [pytest.mark.soak, pytest.mark.timeout(900)]

SANDBOXES = ("bubblewrap", "landlock")
ATTACKS = re.findall(r"^def ([a-z]\w+)\(\):", (AGENTS / "socket_attacker.py").read_text(), re.MULTILINE)
# What is refused whatever an agent is started in: by passwords and by the router's access control.
REFUSED_ANYWAY = {
    "join_another_run", "call_services_past_the_router", "hear_the_truth_on_the_bus", "ask_services_on_the_bus",
    "hear_ros_on_the_bus", "command_by_ros_on_the_bus",
    "ask_the_router_for_its_configuration", "end_the_run",
}  # fmt: skip
# Where a folder that an agent sees holds what is hidden, Landlock still lets it see the names of it.
KNOWN_GAPS = {("landlock", "list_the_sockets_of_the_user")}


def _sockets(ending):
    paths = (line.split()[-1] for line in Path("/proc/net/unix").read_text().splitlines())
    return sorted({path for path in paths if path.endswith(ending) and path.startswith("/")})


@contextmanager
def _ros_graph():
    """The address of a graph of ROS 2, and what a node in it sees of what is forged."""
    pytest.importorskip("rosbags", reason="needs the extra ros")
    from gslcosim_ros.node import RosSession
    from gslcosim_ros.types import RosTypes

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    forged = []
    with RosSession.open(RosTypes("jazzy"), endpoint=endpoint) as session:
        topics = session.zenoh.declare_subscriber("0/beetle/agent/**", forged.append)
        tokens = session.zenoh.liveliness().declare_subscriber("@ros2_lv/**/forged", forged.append)
        yield endpoint, forged
        topics.undeclare()
        tokens.undeclare()


def attacked(folder, sandbox):
    """Fly with the attacker, its program among the sockets of all others: the arrangement that helps it most."""
    if reason := unavailable_reason(sandbox):
        pytest.skip(f"{sandbox} cannot be tested here: {reason}")
    folder.mkdir(parents=True)
    mark = user_state_folder() / "verified" / "known.json"
    mark.parent.mkdir(parents=True, exist_ok=True)
    mark.write_text("what the user has found out")
    with crowded(folder) as crowd, _ros_graph() as (ros_endpoint, forged):
        sockets = crowd.sockets
        for name in ("socket_attacker.py", "raw.py"):
            shutil.copy(AGENTS / name, sockets)
        seen = list_active_runs()
        attacks = {
            "windows": str(get_status_folder()),
            "windows_of_others": [str(each.window) for each in seen],
            "routers": _sockets("router.sock"),
            "meshes": _sockets(".mesh"),
            "mark": str(mark),
            "ros_endpoint": ros_endpoint,
        }
        assert attacks["routers"]
        assert attacks["meshes"]
        start_by = {"command": [sys.executable, str(sockets / "socket_attacker.py"), json.dumps(attacks)]}
        changes = ("--set", f"agents[0].start={json.dumps(start_by)}", "--set", f"agents[0].sandbox={sandbox}")
        # Where temporary files are kept no program is seen unless the user says so.
        changes = (*changes, "--set", f"agents[0].may_read=[{sockets}]")
        changes = (*changes, "--set", f"ros2={{endpoint: '{ros_endpoint}', truth: true}}")
        ended = fly_command(TINY_ROOM, folder / "runs", *changes, "--set", "referee.stop.time_limit_s=6")
        assert {flight.pid for flight in list_active_runs()} == {flight.pid for flight in seen}
        crowd.end()
    assert (ended.result.get("valid"), ended.result.get("end_reason")) == (True, "time_limit"), ended.errors
    assert ended.result["faults"] == []
    lines = (ended.run_dir / "logs" / "agent_beetle.log").read_text().splitlines()
    attacks = [json.loads(line) for line in lines if line.startswith('{"attack"')]
    reached = {line["attack"]: line["reached"] for line in attacks}
    reached["command_by_ros_on_the_bus"] *= bool(forged)
    return reached


@pytest.fixture(scope="module", params=SANDBOXES)
def in_sandbox(request, tmp_path_factory):
    return request.param, attacked(tmp_path_factory.mktemp(request.param) / "x", request.param)


@pytest.mark.parametrize("attack", ATTACKS)
def test_an_attack_does_not_get_through(in_sandbox, attack):
    sandbox, reached = in_sandbox
    assert bool(reached[attack]) is ((sandbox, attack) in KNOWN_GAPS), reached[attack]


def test_without_a_sandbox_the_same_attacks_do_get_through(tmp_path):
    """Otherwise they would prove nothing."""
    reached = attacked(tmp_path / "x", "none")
    refused = {name for name, evidence in reached.items() if not evidence}
    assert refused == REFUSED_ANYWAY


def test_the_table_of_attacks_on_sockets(tmp_path, capsys):
    """Printed for docs/reliability.md, which has the same rows."""
    after = {sandbox: attacked(tmp_path / sandbox, sandbox) for sandbox in (*SANDBOXES, "none")}
    rows = [
        f"| {attack.replace('_', ' ')} | "
        + " | ".join("got through" if each[attack] else "refused" for each in after.values())
        + " |"
        for attack in ATTACKS
    ]
    table = "\n".join([f"| attack | {' | '.join(after)} |", "|---|---|---|---|", *rows])
    with capsys.disabled():
        sys.stdout.write(f"\n{table}\n")
    assert table in (ROOT / "docs" / "reliability.md").read_text()


@pytest.mark.debian
@pytest.mark.timeout(1800)
def test_the_table_of_attacks_on_sockets_holds_for_an_ordinary_user(capsys):
    ran = run_tests_as_ordinary_user(__file__, "-k", "test_the_table_of_attacks and not ordinary", limit_s=1200)
    with capsys.disabled():
        sys.stdout.write(ran.stdout)
    assert ran.returncode == 0
    assert "1 passed" in ran.stdout
