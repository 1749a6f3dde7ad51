"""The winds that events bring: made before the run as environments of the same room, and kept like all of them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gslcosim.environment.model import Environment, WindFrames
from gslcosim.environment.store import load_environment
from gslcosim.errors import EnvironmentDataError
from gslcosim.generation.preparing import prepare_environment
from gslcosim.scenario.models.event_kinds import WindChangesSpec
from gslcosim.scenario.models.scenario import Scenario

if TYPE_CHECKING:
    from gslcosim.generation.winds import Progress


def prepare_later_winds(
    scenario: Scenario, *, scenario_dir: Path | None = None, progress: "Progress | None" = None
) -> dict[int, Path]:
    """Return the environment of each event that brings another wind, by its place in the list; made where needed.

    Args:
        scenario: Its `events`, `environment` and `wind`.
        scenario_dir: What relative paths are relative to; the working directory if absent.
        progress: Is told what is being done; only when there is work.

    Raises:
        GslCosimError: one cannot be made; see `prepare_environment`.
    """
    folders: dict[int, Path] = {}
    for i, event in enumerate(scenario.events):
        if isinstance(event, WindChangesSpec) and event.inlet_velocity_m_s is not None:
            wind = scenario.wind.model_copy(update={"inlet_velocity_m_s": event.inlet_velocity_m_s})
            changed = scenario.model_copy(update={"wind": wind})
            folders[i] = prepare_environment(changed, scenario_dir=scenario_dir, progress=progress).resolve()
    return folders


def with_later_winds(environment: Environment, folders: Mapping[int, Path]) -> Environment:
    """Return an environment that has the winds of other environments of its room, too.

    Args:
        environment: The room.
        folders: Environments by the place of the event that brings their wind.

    Raises:
        EnvironmentDataError: one is of another room.
    """
    winds = {i: _wind_in(folder, environment) for i, folder in folders.items()}
    return replace(environment, later_winds=winds) if winds else environment


def _wind_in(folder: Path, environment: Environment) -> WindFrames:
    other = load_environment(folder)
    if other.grid != environment.grid or not np.array_equal(other.occupancy, environment.occupancy):
        raise EnvironmentDataError(
            f"events: expected wind on the grid of {environment.name}, {environment.grid}, was that of another room, "
            f"{other.grid}. Remove the folder so that it is made anew.\nFolder: {folder}"
        )
    return other.wind
