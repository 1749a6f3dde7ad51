"""What starts with every run is small: a process imports only what its own part needs."""

import subprocess
import sys

import pytest

from gslcosim.runtime.participants import SERVICES

# Each is large and belongs to one service.
OWNERS = {"mujoco": {"world", "cameras"}, "rerun": {"recorder"}}
CORES = {
    "world": "gslcosim.world.core",
    "fields": "gslcosim.fields.core",
    "events": "gslcosim.events.core",
    "radio": "gslcosim.radio.core",
    "cameras": "gslcosim.cameras.core",
    "sensing": "gslcosim.sensing.core",
    "referee": "gslcosim.referee.core",
    "recorder": "gslcosim.recording.core",
}
# What every service does before it builds its own core, and that core.
SCRIPT = """
import importlib, sys
from gslcosim.runtime.over_bus.service import serve
from gslcosim.runtime.assembly import build_core, dataflow_of
importlib.import_module(sys.argv[1])
print(*sorted({"mujoco", "rerun"} & set(sys.modules)))
"""


def test_every_service_is_looked_at():
    assert list(CORES) == [kind.name for kind in SERVICES]


@pytest.mark.slow
@pytest.mark.parametrize("service", CORES)
def test_a_service_imports_no_library_of_another(service):
    """Six processes start at once: what one imports in vain, all wait for."""
    call = [sys.executable, "-c", SCRIPT, CORES[service]]
    imported = subprocess.run(call, capture_output=True, text=True, check=True).stdout.split()
    assert imported == sorted(library for library, owners in OWNERS.items() if service in owners)
