"""Environment of a scenario before its wind is solved: the rooms of all its variants, in still air."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gslcosim.environment.build.geometry_source import build_geometry
from gslcosim.environment.geometry_model import with_wind
from gslcosim.environment.model import Environment, WindFrames
from gslcosim.environment.variants.variant import find_variants, scenario_in_variant
from gslcosim.scenario.models.scenario import Scenario


def build_still_environment(scenario: Scenario, *, scenario_dir: Path) -> Environment:
    """Return the environment of a scenario with what events make of it, all of it without wind.

    Args:
        scenario: Its environment is any but one with a `path`.
        scenario_dir: Where its relative paths start.

    Raises:
        ScenarioError: the layout is impossible.
        EnvironmentDataError: a folder is not what it should be.
    """
    first, *later = find_variants(scenario)
    later_rooms = {variant: _build_room(scenario_in_variant(scenario, variant), scenario_dir) for variant in later}
    return replace(_build_room(scenario_in_variant(scenario, first), scenario_dir), later_rooms=later_rooms)


def _build_room(scenario: Scenario, scenario_dir: Path) -> Environment:
    room = build_geometry(scenario.environment, scenario.wind, scenario_dir=scenario_dir)
    return with_wind(room, WindFrames(velocity_m_s=np.zeros((1, *room.grid.shape, 3), np.float32)))
