"""What events make of a room: made before the run as environments of their own, and kept like all of them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gslcosim.environment.model import Environment, Situation
from gslcosim.environment.situations import scenario_in, situations_of
from gslcosim.environment.store import load_environment
from gslcosim.errors import EnvironmentDataError
from gslcosim.generation.preparing import prepare_environment
from gslcosim.scenario.models.scenario import Scenario

if TYPE_CHECKING:
    from gslcosim.generation.winds import Progress


def prepare_later_rooms(
    scenario: Scenario, *, scenario_dir: Path | None = None, progress: "Progress | None" = None
) -> dict[Situation, Path]:
    """Return the environment of each situation that events may bring, but the first one; made where needed.

    Args:
        scenario: Its `events`, `environment` and `wind`.
        scenario_dir: What relative paths are relative to; the working directory if absent.
        progress: Is told what is being done; only when there is work.

    Raises:
        GslCosimError: one cannot be made; see `prepare_environment`.
    """
    folders: dict[Situation, Path] = {}
    for situation in situations_of(scenario)[1:]:
        changed = scenario_in(scenario, situation)
        folders[situation] = prepare_environment(changed, scenario_dir=scenario_dir, progress=progress).resolve()
    return folders


def with_later_rooms(environment: Environment, folders: Mapping[Situation, Path]) -> Environment:
    """Return an environment that knows what events make of it.

    Args:
        environment: The room at the start.
        folders: Environments by situation.

    Raises:
        EnvironmentDataError: one is of another room.
    """
    rooms: dict[Situation, Environment] = {}
    for situation, folder in folders.items():
        room = load_environment(folder)
        has_moved_door = room.boxes != environment.boxes
        if room.grid != environment.grid or not (
            has_moved_door or np.array_equal(room.occupancy, environment.occupancy)
        ):
            raise EnvironmentDataError(
                f"events: expected a room on the grid of {environment.name}, {environment.grid}, was another, "
                f"{room.grid}. Remove the folder so that it is made anew.\nFolder: {folder}"
            )
        rooms[situation] = room
    return replace(environment, later_rooms=rooms) if rooms else environment
