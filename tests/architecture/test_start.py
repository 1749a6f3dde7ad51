"""What starts with every run is small: a process imports only what its own part needs."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.scenario import load_scenario

ROOT = Path(__file__).parents[2]
PROJECTS = (ROOT / "pyproject.toml", *sorted(ROOT.glob("extensions/*/pyproject.toml")))
# Each is large and belongs to one service.
# A vehicle in ROS 2 is described with the masses and shapes of its model.
OWNERS = {"mujoco": {"world", "cameras", "ros2"}, "rerun": {"recorder"}}
# The supervisor of a run in a room that was made before compiles nothing, draws nothing and solves nothing.
NOT_THE_SUPERVISORS = {"mujoco", "rerun", "pyarrow", "numba", "scipy", "PIL"}
CORES = {
    "world": "gslcosim_services.world.core",
    "fields": "gslcosim_services.fields.core",
    "events": "gslcosim_services.events.core",
    "radio": "gslcosim_services.radio.core",
    "cameras": "gslcosim_services.cameras.core",
    "sensing": "gslcosim_services.sensing.core",
    "referee": "gslcosim_services.referee.core",
    "recorder": "gslcosim_services.recorder.core",
    "ros2": "gslcosim_ros.live.core",
}
# What every service does before it builds its own core, and that core.
SCRIPT = """
import importlib, sys
from gslcosim.runtime.distributed.service_main import serve
from gslcosim.runtime.services import build_core, build_dataflow
importlib.import_module(sys.argv[1])
if sys.argv[1] == "gslcosim_services.recorder.core":
    import gslcosim_services.recorder.run_recording  # imported when the recording is opened
print(*sorted({"mujoco", "rerun"} & set(sys.modules)))
"""
SUPERVISOR = """
import argparse, importlib, sys
from gslcosim.cli.commands import up
from gslcosim.cli.arguments import load_checked
parser = argparse.ArgumentParser()
up.UP.add_arguments(parser)
loaded = load_checked(parser.parse_args(["warehouse_empty"]))
for module in ("gslcosim.runtime.run", "gslcosim.runtime.distributed.process_launch", "gslcosim.cli.run_output"):
    importlib.import_module(module)
from gslcosim.environment.generation.cache import prepare_environment
prepare_environment(loaded.scenario, scenario_dir=loaded.directory)
print(*sorted(sys.modules))
"""

RECORDER = """
import sys
from gslcosim_services.recorder.service import preload_modules
preload_modules()
from pathlib import Path
from gslcosim.environment.store import load_environment
from gslcosim_services.recorder.core import RecorderCore
from gslcosim.scenario import load_scenario
core = RecorderCore(load_scenario("warehouse_empty").scenario, load_environment(Path(sys.argv[1])), Path(sys.argv[2]))
before = {name for name in sys.modules if not name.startswith("pandas")}
core.reset(None)
core.close()
print(*sorted(name for name in set(sys.modules) - before if name.startswith(("gslcosim", "pandas", "rerun"))))
"""


@pytest.fixture(scope="module")
def quickstart_room():
    """Made before, as by any earlier flight."""
    loaded = load_scenario("warehouse_empty")
    return prepare_environment(loaded.scenario, scenario_dir=loaded.directory)


def test_every_service_is_looked_at():
    projects = [tomllib.loads(path.read_text())["project"] for path in PROJECTS]
    declared = [project.get("entry-points", {}).get("gslcosim.default_services", {}) for project in projects]
    assert list(CORES) == [name for services in declared for name in services]


@pytest.mark.slow
@pytest.mark.parametrize("service", CORES)
def test_a_service_imports_no_library_of_another(service):
    """Six processes start at once: what one imports in vain, all wait for."""
    call = [sys.executable, "-c", SCRIPT, CORES[service]]
    imported = subprocess.run(call, capture_output=True, text=True, check=True).stdout.split()
    assert imported == sorted(library for library, owners in OWNERS.items() if service in owners)


@pytest.mark.slow
def test_a_supervisor_imports_nothing_that_computes(quickstart_room):
    """All processes of a run wait for it: numba, scipy and what draws took half of its start."""
    call = [sys.executable, "-c", SUPERVISOR]
    imported = set(subprocess.run(call, capture_output=True, text=True, check=True).stdout.split())
    assert imported & NOT_THE_SUPERVISORS == set()


@pytest.mark.slow
def test_a_fork_server_starts_with_nothing_but_python():
    """It is started first of all, so that it imports while the supervisor does."""
    script = "import sys; from gslcosim.runtime.processes.fork_server import ForkServer; print(*sorted(sys.modules))"
    imported = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True).stdout.split()
    assert {"pydantic", "numpy", "gslcosim.scenario"} & set(imported) == set()


@pytest.mark.slow
def test_a_recorder_that_has_imported_early_imports_nothing_in_the_run(quickstart_room, tmp_path):
    """What it imports later, the flight waits for: pandas, which pyarrow looks for, was half of it."""
    call = [sys.executable, "-c", RECORDER, str(quickstart_room), str(tmp_path / "r.rrd")]
    assert subprocess.run(call, capture_output=True, text=True, check=True).stdout.split() == []
