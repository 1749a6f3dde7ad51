"""The commands of compose.yaml, run as processes of this machine: all but the containers themselves."""

import json
import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from deadlines import EVENT_S, PROCESS_S

ROOT = Path(__file__).parents[2]
BIN = Path(sys.executable).parent


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


@pytest.fixture
def services() -> dict:
    """The services as the compose tool understands them."""
    tool = shutil.which("docker-compose", path=f"{BIN}{os.pathsep}{os.environ['PATH']}")
    if tool is None:
        pytest.skip("no compose tool here: the extra test-all brings one for Linux on x86_64")
    command = [tool, "--file", str(ROOT / "compose.yaml"), "config", "--format", "json"]
    variables = os.environ | {"SCENARIO": "tiny_room"}
    outcome = subprocess.run(command, env=variables, capture_output=True, text=True, check=True)
    return json.loads(outcome.stdout)["services"]


@pytest.mark.end_to_end
@pytest.mark.extras
def test_the_processes_of_compose_make_one_run(services, tmp_path):
    """Volumes become folders, and the supervisor's host becomes this one; services start before their files exist."""
    replaced = {
        "/join": f"{tmp_path}/join",
        "/runs": f"{tmp_path}/runs",
        "supervisor:7447": f"127.0.0.1:{free_port()}",
    }

    def here(text: str) -> str:
        for old, new in replaced.items():
            text = text.replace(old, new)
        return text

    def start(name: str) -> subprocess.Popen[str]:
        program, *arguments = services[name]["command"]
        variables = {key: here(value) for key, value in (services[name].get("environment") or {}).items()}
        command = [str(BIN / program), *map(here, arguments), *(["--json"] if name == "supervisor" else [])]
        return subprocess.Popen(
            command, env=os.environ | variables, text=True, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )

    processes = {name: start(name) for name in sorted(services, key=lambda name: name == "supervisor")}
    try:
        output = processes["supervisor"].communicate(timeout=PROCESS_S)[0]
        codes = {name: process.wait(timeout=EVENT_S) for name, process in processes.items()}
    finally:
        for process in processes.values():
            process.kill()
            process.communicate()
    assert codes.pop("supervisor") in (0, 1), output
    assert set(codes.values()) == {0}, codes
    result = json.loads(output[output.index("{") :])
    assert (result["valid"], result["scenario"], len(result["agents"])) == (True, "tiny_room", 1)
