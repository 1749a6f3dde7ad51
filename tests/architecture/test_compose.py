"""compose.yaml is valid for the compose tool and starts each process of a run once."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gslcosim.runtime.services import list_service_names
from gslcosim.scenario import load_scenario

pytestmark = pytest.mark.extras
ROOT = Path(__file__).parents[2]


def compose_command() -> list[str]:
    bundled = Path(sys.executable).parent / "docker-compose"
    if bundled.exists():
        return [str(bundled)]
    if found := shutil.which("docker-compose"):
        return [found]
    plugin = (
        subprocess.run(["docker", "compose", "version"], capture_output=True, check=False)
        if shutil.which("docker")
        else None
    )
    if plugin is not None and plugin.returncode == 0:
        return ["docker", "compose"]
    pytest.skip("no compose tool here: the extra test-all brings one for Linux on x86_64")


@pytest.fixture(scope="module")
def services() -> dict:
    """The services as the compose tool understands them."""
    command = [*compose_command(), "--file", str(ROOT / "compose.yaml"), "config", "--format", "json"]
    outcome = subprocess.run(command, capture_output=True, text=True, check=False)
    assert outcome.returncode == 0, outcome.stderr
    return json.loads(outcome.stdout)["services"]


def mounts(service: dict) -> set[str]:
    return {volume["source"] for volume in service["volumes"]}


def test_there_is_one_container_for_each_process(services):
    scenario = load_scenario("warehouse_empty").scenario
    agents = {f"agent-{agent.name}" for agent in scenario.agents}
    assert set(services) == {"supervisor", *list_service_names(scenario), *agents}


def test_all_run_the_same_image(services):
    assert {service["image"] for service in services.values()} == {"gslcosim:local"}


def test_each_service_joins_with_its_own_join_file(services):
    for name in set(services) - {"supervisor", "agent-beetle"}:
        assert services[name]["command"] == ["gslcosim", "join", "--wait=120", f"/join/services/{name}.json", name]


def test_an_agents_container_holds_neither_the_run_nor_the_services_passwords(services):
    assert mounts(services["agent-beetle"]) == {"join-agents"}
    assert "join-agents" not in mounts(services["world"])


def test_the_supervisor_uses_the_folder_of_the_others(services):
    command = services["supervisor"]["command"]
    assert {"--join-dir=/join", "--no-services", "--listen=tcp/supervisor:7447", "--insecure"} <= set(command)
    assert mounts(services["supervisor"]) == {"runs", "cache", "join-services", "join-agents"}


def test_an_agents_container_is_bounded_and_changes_nothing(services):
    agent = services["agent-beetle"]
    assert agent["read_only"] is True
    assert agent["cap_drop"] == ["ALL"]
    assert agent["security_opt"] == ["no-new-privileges:true"]
    assert (int(agent["mem_limit"]), agent["pids_limit"]) == (1 << 30, 128)
    assert agent["tmpfs"] == ["/tmp:size=256m,mode=1777"]
    assert agent["environment"]["GSLCOSIM_CACHE"].startswith("/tmp/")
