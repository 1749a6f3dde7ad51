"""Cache of environments: made from a scenario once, and found again by what they were made from."""

import logging
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from gslcosim.base.disk_cache import keep_within_limit, mark_used
from gslcosim.base.errors import EnvironmentDataError
from gslcosim.base.kernel_cache import get_cache_root
from gslcosim.base.os_errors import build_machine_error
from gslcosim.environment.generation.recipe_hash import recipe_hash
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.scenario.models.scenario import Scenario

if TYPE_CHECKING:
    from gslcosim.environment.generation.wind import Progress

_log = logging.getLogger(__name__)


def prepare_environment(
    scenario: Scenario,
    *,
    scenario_dir: Path | None = None,
    cache_dir: Path | None = None,
    progress: "Progress | None" = None,
) -> Path:
    """Return the folder of a scenario's environment, made now if it was not made before.

    An environment from a layout, or from the folder of another program, is kept in the cache under a hash of all it
    depends on: layout or files, wind, the code that makes rooms and solves the wind, and the packages that compile it.
    Processes may call this at the same time: each makes the environment, the first to finish keeps its folder, and all
    return it. A folder that was damaged since is made again.

    Args:
        scenario: Its `environment` and `wind`; with `environment.path` its `wind` has no meaning.
        scenario_dir: What relative paths are relative to; the working directory if absent.
        cache_dir: Where made environments are kept; `environments` in `gslcosim`'s cache if absent.
        progress: Receives what is being done and how much of it is over, from 0 to 1; only when there is work.

    Raises:
        ScenarioError: the room is impossible.
        EnvironmentDataError: a folder or file is not what it should be.
        FlowError: the wind cannot be solved.
        MachineError: the cache cannot be written.
    """
    spec, wind = scenario.environment, scenario.wind
    if spec.path is not None:
        from gslcosim.environment.build.geometry_source import find_folder

        return _checked_folder(find_folder(spec, scenario_dir))
    folder = _folder_in_cache(scenario, scenario_dir, cache_dir)
    mark_used(folder)
    if not _is_usable(folder):
        from gslcosim.environment.generation.builder import generate_environment

        try:
            generate_environment(spec, wind, folder, scenario_dir=scenario_dir, progress=progress)
        except OSError as error:
            # A disk without room does not say which file it was.
            if error.filename is not None and not Path(error.filename).is_relative_to(folder.parent.parent):
                raise
            remedy = "Free room there, or set GSLCOSIM_CACHE to a folder that can be written."
            raise build_machine_error(
                error, "cache", "a folder that can be written", path=folder.parent, remedy=remedy
            ) from error
        keep_within_limit()
    return folder


def find_environment(scenario: Scenario, *, scenario_dir: Path | None = None) -> Environment | None:
    """Return a scenario's environment where `prepare_environment` has made it before, else nothing.

    What was made had no problems: its room need not be built again to be checked. This is for environments from a
    layout; files of other programs are not read for it.
    """
    if scenario.environment.layout is None or scenario.wind.file is not None:
        return None
    with suppress(EnvironmentDataError):
        folder = _folder_in_cache(scenario, scenario_dir, None)
        mark_used(folder)
        return load_environment(folder) if folder.exists() else None
    return None


def _checked_folder(folder: Path) -> Path:
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        raise EnvironmentDataError(f"environment.path: {error}") from error
    return folder


def _folder_in_cache(scenario: Scenario, scenario_dir: Path | None, cache_dir: Path | None) -> Path:
    name = recipe_hash(scenario.environment, scenario.wind, scenario_dir=scenario_dir)
    return (cache_dir or get_cache_root() / "environments") / name


def _is_usable(folder: Path) -> bool:
    if not folder.exists():
        return False
    try:
        load_environment(folder)
    except EnvironmentDataError as error:
        _log.warning("An environment in the cache is damaged and is made anew: %s", error)
        return False
    return True
