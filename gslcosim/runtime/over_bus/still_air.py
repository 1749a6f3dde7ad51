"""The services of a scenario rehearsed without its wind, so that kernels are compiled before there is one."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from gslcosim.environment.model import Environment, WindFrames
from gslcosim.environment.of_scenario.room_origin import room_of
from gslcosim.environment.room import with_wind
from gslcosim.environment.situations import scenario_in, situations_of
from gslcosim.runtime.assembly import build_core
from gslcosim.runtime.participants import services_of
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import Setup
from gslcosim.scenario import Scenario, dump_resolved

# By far the most kernels; the others are compiled while the flight waits for these.
_FIRST = "fields"


def request_to_rehearse(scenario: Scenario, directory: Path) -> dict[str, Any]:
    """Return as plain values what `rehearse_requested` is asked for."""
    return {"scenario": dump_resolved(scenario), "directory": str(directory.absolute())}


def rehearse_requested(request: dict[str, Any]) -> None:
    """Rehearse what `request_to_rehearse` has asked for."""
    rehearse_in_still_air(Scenario.model_validate(yaml.safe_load(request["scenario"])), Path(request["directory"]))


def rehearse_in_still_air(scenario: Scenario, directory: Path) -> None:
    """Build and rehearse the services of a scenario in its room; what they compile is kept in the cache.

    Args:
        scenario: Its environment is any but one with a `path`.
        directory: Where its relative paths start.
    """
    first, *later = situations_of(scenario)
    later_rooms = {situation: _in_still_air(scenario_in(scenario, situation), directory) for situation in later}
    environment = replace(_in_still_air(scenario_in(scenario, first), directory), later_rooms=later_rooms)
    setup = Setup(run_dir=RunDir(directory), scenario=scenario, environment_dir=directory, environment=environment)
    rehearsed = [kind.name for kind in services_of(scenario) if kind.is_rehearsed]
    for name in sorted(rehearsed, key=lambda name: name != _FIRST):
        build_core(name, setup)


def _in_still_air(scenario: Scenario, directory: Path) -> Environment:
    room = room_of(scenario.environment, scenario.wind, scenario_dir=directory)
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))
