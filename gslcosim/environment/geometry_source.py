"""Geometry of a scenario's environment, from a layout, a folder or files; and the same in still air."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from gslcosim.base.problems import Problem
from gslcosim.environment.layouts.layouts import build_layout, find_room_problems
from gslcosim.environment.model import Environment, EnvironmentGeometry, WindFrames, raise_if_any, with_wind
from gslcosim.environment.readers import find_missing_readers, find_room_reader
from gslcosim.environment.variants import (
    DOORS_PATH,
    add_closed_doors,
    find_cut_off_openings,
    find_door_problems,
    find_variants,
    scenario_in_variant,
)
from gslcosim.scenario.models.scenario import EnvironmentSpec, Scenario, SolverSpec


def find_folder(spec: EnvironmentSpec, scenario_dir: Path | None) -> Path:
    """Return the folder of a scenario's environment, which has a `folder_key`.

    Args:
        spec: The scenario's environment block.
        scenario_dir: Base folder of a relative path; the working directory if absent.
    """
    assert spec.folder_key is not None, "a layout has no folder"
    folder = Path(getattr(spec, spec.folder_key)).expanduser()
    return folder if folder.is_absolute() or scenario_dir is None else scenario_dir / folder


def build_geometry(spec: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None = None) -> EnvironmentGeometry:
    """Return the room of an environment that has no wind yet: of any but one with a `path`.

    Args:
        spec: The scenario's environment block.
        wind: Gives a generated room its cells, and the inlets their velocity.
        scenario_dir: Base folder of relative paths.
    """
    room = _room_without_doors(spec, wind, scenario_dir)
    if spec.doors:
        raise_if_any(_problems_with_doors(room, spec))
    return add_closed_doors(room, spec.doors)


def _problems_with_doors(room: EnvironmentGeometry, spec: EnvironmentSpec) -> list[Problem]:
    return find_door_problems(room, spec.doors) or find_cut_off_openings(add_closed_doors(room, spec.doors), DOORS_PATH)


def _room_without_doors(spec: EnvironmentSpec, wind: SolverSpec, scenario_dir: Path | None) -> EnvironmentGeometry:
    if spec.layout is None:
        return find_room_reader(spec).read(spec, wind, scenario_dir)
    return build_layout(spec.layout, wind)


def find_source_problems(spec: EnvironmentSpec, wind: SolverSpec, *, scenario_dir: Path | None = None) -> list[Problem]:
    """Return all problems of building or reading a room, with the places in the scenario."""
    problems = find_missing_readers(spec, wind)
    if not problems and spec.layout is not None:
        problems = find_room_problems(spec.layout, wind)
    elif not problems:
        problems = find_room_reader(spec).find_problems(spec, wind, scenario_dir)
    if problems or not spec.doors:
        return problems
    return _problems_with_doors(_room_without_doors(spec, wind, scenario_dir), spec)


def build_unsolved_environment(scenario: Scenario, *, scenario_dir: Path) -> Environment:
    """Return the environment of a scenario with its variants, all in the even wind of their inlets, k and epsilon 1.

    Args:
        scenario: Its environment is any but one with a `path`.
        scenario_dir: Base folder of relative paths.
    """
    first, *later = find_variants(scenario)
    later_rooms = {variant: _build_room(scenario_in_variant(scenario, variant), scenario_dir) for variant in later}
    return replace(_build_room(scenario_in_variant(scenario, first), scenario_dir), later_rooms=later_rooms)


def _build_room(scenario: Scenario, scenario_dir: Path) -> Environment:
    room = build_geometry(scenario.environment, scenario.wind, scenario_dir=scenario_dir)
    velocity_m_s = np.full((1, *room.grid.shape, 3), scenario.wind.inlet_velocity_m_s, np.float32)
    return with_wind(room, WindFrames(velocity_m_s=velocity_m_s, k_epsilon=np.ones((*room.grid.shape, 2), np.float32)))
