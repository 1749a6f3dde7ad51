"""Warm-up of a scenario's services before its wind is solved, so that kernels are compiled meanwhile."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gslcosim.environment.build.geometry_source import build_geometry
from gslcosim.environment.geometry_model import with_wind
from gslcosim.environment.model import Environment, WindFrames
from gslcosim.environment.variants.variant import find_variants, scenario_in_variant
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.services import build_core, list_services
from gslcosim.runtime.setup import RunSetup
from gslcosim.scenario import Scenario, dump_resolved

# By far the most kernels; the others are compiled while the run waits for these.
_FIRST_SERVICE = "fields"


def build_warmup_request(scenario: Scenario, directory: Path) -> dict[str, Any]:
    """Return as plain values what `run_warmup_request` is asked for."""
    return {"scenario": dump_resolved(scenario), "directory": str(directory.absolute())}


def run_warmup_request(request: dict[str, Any]) -> None:
    """Rehearse what `build_warmup_request` has asked for."""
    warm_up_without_wind(Scenario.model_validate(yaml.safe_load(request["scenario"])), Path(request["directory"]))


def warm_up_without_wind(scenario: Scenario, directory: Path) -> None:
    """Build and warm up the services of a scenario in its room; what they compile is kept in the cache.

    Args:
        scenario: Its environment is any but one with a `path`.
        directory: Where its relative paths start.
    """
    first, *later = find_variants(scenario)
    later_rooms = {
        variant: _build_windless_setups(scenario_in_variant(scenario, variant), directory) for variant in later
    }
    environment = replace(
        _build_windless_setups(scenario_in_variant(scenario, first), directory), later_rooms=later_rooms
    )
    setup = RunSetup(run_dir=RunDir(directory), scenario=scenario, environment_dir=directory, environment=environment)
    rehearsed = [kind.name for kind in list_services(scenario) if kind.is_warmed_up]
    for name in sorted(rehearsed, key=lambda name: name != _FIRST_SERVICE):
        build_core(name, setup)


def _build_windless_setups(scenario: Scenario, directory: Path) -> Environment:
    room = build_geometry(scenario.environment, scenario.wind, scenario_dir=directory)
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))
