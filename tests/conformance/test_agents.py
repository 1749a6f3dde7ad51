"""Every agent that ships keeps every rule, through every door that it speaks."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import yaml

from gslcosim._kernel_cache import cache_root
from gslcosim.conformance import Limits, Wiring, check_agent
from gslcosim.conformance.creation import create_agent

ROOT = Path(__file__).parents[2]
FRAMED = ROOT / "tests" / "end_to_end" / "agents" / "framed.py"
DESCRIPTIONS = sorted((ROOT / "agents").glob("*/agent.yaml"))
LIMITS = Limits(exit_s=2.0)

pytestmark = [pytest.mark.slow, pytest.mark.end_to_end]


PYTHON = {
    name: (sys.executable, str(ROOT / "agents" / name / "agent.py")) for name in ("dung_beetle", "calling_beetle")
}
WAYS = [(door, frame_format) for door in ("stdio", "tcp", "unix") for frame_format in ("msgpack", "json")]
N_AT_ONCE = 3


def python_wirings():
    """Yield the Python agents over Zenoh, and one through each door and format of the gateway."""
    for name, command in PYTHON.items():
        yield name, Wiring(command=command)
    for door, frame_format in WAYS:
        command = (sys.executable, str(FRAMED), "stdio" if door == "stdio" else "socket", frame_format)
        yield f"{door}-{frame_format}", Wiring(command=command, door=door, format=frame_format)


@pytest.fixture(scope="module")
def reports():
    """The reports of the Python agents, made several at a time: a check mostly waits."""
    with ThreadPoolExecutor(N_AT_ONCE) as pool:
        yield {name: pool.submit(check_agent, wiring, LIMITS) for name, wiring in python_wirings()}


@pytest.mark.parametrize("name", [name for name, _ in python_wirings()])
def test_a_python_agent_keeps_every_rule(name, reports):
    report = reports[name].result()
    assert report.has_passed, report.as_text()


def test_a_new_python_agent_keeps_every_rule(tmp_path):
    created = create_agent("python", "gas_finder", tmp_path / "new")
    report = check_agent(Wiring(command=created.start), LIMITS)
    assert report.has_passed, report.as_text()


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(
            path,
            id=path.parent.name,
            marks=[pytest.mark.soak] if yaml.safe_load(path.read_text()).get("slow_to_build") else [],
        )
        for path in DESCRIPTIONS
    ],
)
def test_an_agent_of_another_language_keeps_every_rule(path):
    fields = yaml.safe_load(path.read_text())
    if lacking := [program for program in fields["needs"] if shutil.which(program) is None]:
        pytest.skip(f"{path.parent.name} is not checked: this machine has no {', '.join(lacking)}")
    for library in fields.get("libraries", ()):
        if subprocess.run(["pkg-config", "--exists", library], check=False).returncode:
            pytest.skip(f"{path.parent.name} is not checked: this machine has no library {library}")
    build_folder = str(cache_root() / "agents" / path.parent.name)

    def filled(key):
        words = [word.replace("{build}", build_folder) for word in fields.get(key) or ()]
        return [str(path.parent / word) if (path.parent / word).is_file() else word for word in words]

    if fields.get("build"):
        built = subprocess.run(
            filled("build"), cwd=path.parent, capture_output=True, text=True, env=os.environ, check=False
        )
        assert built.returncode == 0, built.stdout + built.stderr
    wiring = Wiring(
        command=tuple(filled("start")),
        door=fields["door"],
        format=fields["format"],
        observations=fields.get("observations", "all"),
    )
    report = check_agent(wiring, LIMITS)
    assert report.has_passed, report.as_text()
