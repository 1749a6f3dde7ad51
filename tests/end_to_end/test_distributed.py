"""Processes that somebody else starts join over TCP, as in compose.yaml, and give the same digest."""

import os
import socket
import subprocess
import sys

from deadlines import EVENT_S
from real_runs import ROOT, TINY_ROOM, fly_here, start

SERVICES = ("world", "fields", "sensing", "referee", "recorder")


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def join(join_file, *command):
    environment = {**os.environ, "GSLCOSIM_JOIN": str(join_file)}
    return subprocess.Popen([sys.executable, *command], env=environment)


def test_services_and_agent_started_elsewhere_join_by_their_files(tmp_path):
    """The supervisor starts nothing; everyone finds its join file, and all of them end with the run."""
    joins = tmp_path / "join"
    agent = ROOT / "agents" / "dung_beetle" / "agent.py"
    # Started before the supervisor: the files do not exist yet.
    others = [join(joins / "services" / f"{name}.json", "-m", "gslcosim_services", name) for name in SERVICES]
    others.append(join(joins / "agents" / "beetle.json", str(agent)))
    flight = start(
        TINY_ROOM,
        tmp_path / "runs",
        "--no-services",
        f"--listen=tcp/127.0.0.1:{free_port()}",
        f"--join-dir={joins}",
        "--set",
        "agents[0].start={attach: true}",
        is_recorded=True,
    )
    try:
        ended = flight.end()
        assert ended.result.get("valid") is True, ended.errors
        assert [process.wait(timeout=EVENT_S) for process in others] == [0] * len(others)
    finally:
        for process in others:
            process.kill()
            process.wait()
    alone = fly_here(TINY_ROOM, tmp_path / "alone")
    assert ended.result["digest"] == alone.result["digest"]
