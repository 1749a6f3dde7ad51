"""From a scenario to the folder of its environment: made once, kept by what it was made from."""

import logging
from pathlib import Path

from gslcosim._kernel_cache import cache_root
from gslcosim.environment.of_scenario.room_origin import folder_of
from gslcosim.environment.store import load_environment
from gslcosim.errors import EnvironmentDataError
from gslcosim.generation.making import generate_environment
from gslcosim.generation.recipe_hash import recipe_hash
from gslcosim.generation.winds import Progress
from gslcosim.machine import machine_error
from gslcosim.scenario.models.scenario import Scenario

_log = logging.getLogger(__name__)


def prepare_environment(
    scenario: Scenario,
    *,
    scenario_dir: Path | None = None,
    cache_dir: Path | None = None,
    progress: Progress | None = None,
) -> Path:
    """Return the folder of a scenario's environment, made now if it was not made before.

    An environment from a layout, or from the folder of another program, is kept in the cache under a hash of all it
    depends on: layout or files, wind, the code that makes rooms and solves the wind, and the packages that compile it.
    Processes may call this at the same time: each makes the environment, the first to finish keeps its folder, and all
    return it. A folder that was damaged since is made anew.

    Args:
        scenario: Its `environment` and `wind`; with `environment.path` its `wind` has no meaning.
        scenario_dir: What relative paths are relative to; the working directory if absent.
        cache_dir: Where made environments are kept; `environments` in `gslcosim`'s cache if absent.
        progress: Is told what is being done and how much of it is over, from 0 to 1; only when there is work.

    Raises:
        ScenarioError: the room is impossible.
        EnvironmentDataError: a folder or file is not what it should be.
        FlowError: the wind cannot be solved.
        MachineError: the cache cannot be written.
    """
    spec, wind = scenario.environment, scenario.wind
    if spec.path is not None:
        return _checked_folder(folder_of(spec, scenario_dir))
    folder = (cache_dir or cache_root() / "environments") / recipe_hash(spec, wind, scenario_dir=scenario_dir)
    if not _is_usable(folder):
        try:
            generate_environment(spec, wind, folder, scenario_dir=scenario_dir, progress=progress)
        except OSError as error:
            # A disk without room does not say which file it was.
            if error.filename is not None and not Path(error.filename).is_relative_to(folder.parent.parent):
                raise
            remedy = "Free room there, or set GSLCOSIM_CACHE to a folder that can be written."
            raise machine_error(
                error, "cache", "a folder that can be written", path=folder.parent, remedy=remedy
            ) from error
    return folder


def _checked_folder(folder: Path) -> Path:
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        raise EnvironmentDataError(f"environment.path: {error}") from error
    return folder


def _is_usable(folder: Path) -> bool:
    if not folder.exists():
        return False
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        _log.warning("An environment in the cache is damaged and is made anew: %s", error)
        return False
    return True
