"""Variants of an environment that events may bring: generated before the run, and cached like all environments."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gslcosim.base.errors import EnvironmentDataError
from gslcosim.environment.generation.cache import prepare_environment
from gslcosim.environment.model import Environment, EnvironmentVariant
from gslcosim.environment.store import load_environment
from gslcosim.environment.variants.variant import find_variants, scenario_in_variant
from gslcosim.scenario.models.scenario import Scenario

if TYPE_CHECKING:
    from gslcosim.environment.generation.wind import Progress


def prepare_variants(
    scenario: Scenario, *, scenario_dir: Path | None = None, progress: "Progress | None" = None
) -> dict[EnvironmentVariant, Path]:
    """Return the environment of each situation that events may bring, but the first one; made where needed.

    Args:
        scenario: Its `events`, `environment` and `wind`.
        scenario_dir: What relative paths are relative to; the working directory if absent.
        progress: Receives what is being done; only when there is work.

    Raises:
        GslCosimError: one cannot be made; see `prepare_environment`.
    """
    folders: dict[EnvironmentVariant, Path] = {}
    for variant in find_variants(scenario)[1:]:
        changed = scenario_in_variant(scenario, variant)
        folders[variant] = prepare_environment(changed, scenario_dir=scenario_dir, progress=progress).resolve()
    return folders


def with_variants(environment: Environment, folders: Mapping[EnvironmentVariant, Path]) -> Environment:
    """Return an environment that knows what events make of it.

    Args:
        environment: The room at the start.
        folders: Environments by situation.

    Raises:
        EnvironmentDataError: one is of another room.
    """
    rooms: dict[EnvironmentVariant, Environment] = {}
    for variant, folder in folders.items():
        room = load_environment(folder)
        has_moved_door = room.boxes != environment.boxes
        if room.grid != environment.grid or not (
            has_moved_door or np.array_equal(room.occupancy, environment.occupancy)
        ):
            raise EnvironmentDataError(
                f"events: expected a room on the grid of {environment.name}, {environment.grid}, was another, "
                f"{room.grid}. Remove the folder so that it is made anew.\nFolder: {folder}"
            )
        rooms[variant] = room
    return replace(environment, later_rooms=rooms) if rooms else environment
