"""Warm-up of a scenario's services before its environment is made, so that kernels are compiled meanwhile."""

from pathlib import Path
from typing import Any

import yaml

from gslcosim.environment.geometry_source import build_still_environment
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_core, list_services
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario, dump_resolved


def build_warmup_request(scenario: Scenario, directory: Path) -> dict[str, Any]:
    """Return a request for `run_warmup_request`, as plain values."""
    return {"scenario": dump_resolved(scenario), "directory": str(directory.absolute())}


def run_warmup_request(request: dict[str, Any]) -> None:
    """Warm up the services that a request of `build_warmup_request` names."""
    warm_up_services(Scenario.model_validate(yaml.safe_load(request["scenario"])), Path(request["directory"]))


def warm_up_services(scenario: Scenario, directory: Path) -> None:
    """Build and warm up the services of a scenario in its room; what they compile is kept in the cache.

    Args:
        scenario: Its environment is any but one with a `path`.
        directory: Where its relative paths start.
    """
    environment = build_still_environment(scenario, scenario_dir=directory)
    setup = RunSetup(run_dir=RunDir(directory), scenario=scenario, environment_dir=directory, environment=environment)
    services = [kind for kind in list_services(scenario) if kind.is_warmed_up]
    for kind in sorted(services, key=lambda kind: not kind.has_most_kernels):
        build_core(kind.name, setup)
