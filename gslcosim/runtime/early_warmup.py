"""Warm-up of a scenario's services before its environment is made, so that kernels are compiled meanwhile."""

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path

import yaml

from gslcosim.base.errors import SimulationFault
from gslcosim.environment.geometry_source import build_still_environment
from gslcosim.runtime.processes.fork_server import ForkedProcess, ForkServer
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_core, list_services
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario, dump_resolved


def fork_warmup(fork_server: ForkServer, scenario: Scenario, directory: Path) -> ForkedProcess | None:
    """Let a fork compile as many kernels of a scenario's services as it can while the environment is built.

    Returns the fork; None if the server has ended, of which the caller is informed separately.
    """
    request = {"scenario": dump_resolved(scenario), "directory": str(directory.absolute())}
    with contextlib.suppress(SimulationFault):
        return fork_server.fork("warm-up", {"warm_up": request}, log=Path(os.devnull))
    return None


def run_warmup_request(request: Mapping[str, str]) -> None:
    """Build and warm up the services of the scenario of `fork_warmup` in its room, which is any but one with a `path`.

    The cache keeps the kernels that they compile.
    """
    scenario, directory = Scenario.model_validate(yaml.safe_load(request["scenario"])), Path(request["directory"])
    environment = build_still_environment(scenario, scenario_dir=directory)
    setup = RunSetup(run_dir=RunDir(directory), scenario=scenario, environment_dir=directory, environment=environment)
    services = [kind for kind in list_services(scenario) if kind.is_warmed_up]
    for kind in sorted(services, key=lambda kind: not kind.has_most_kernels):
        build_core(kind.name, setup)
