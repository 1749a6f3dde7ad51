"""Builder of environments: geometry and wind into a folder."""

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from gslcosim import flow
from gslcosim.environment.generation.cache import recipe
from gslcosim.environment.generation.wind import Progress, no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Environment, with_wind
from gslcosim.environment.store import REPORT_FILE, save_environment
from gslcosim.environment.variants import fill_still_air
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec

# From an environment, and the report of its wind if that was solved, its views for people and other programs: files by
# name.
DrawViews = Callable[[Environment, flow.WindReport | None], Mapping[str, bytes]]

_log = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class BuildResult:
    """A generated environment, and notices about it for the user."""

    environment: Environment
    notices: tuple[str, ...]


def generate_environment(
    spec: EnvironmentSpec,
    wind: SolverSpec,
    folder: Path,
    *,
    scenario_dir: Path | None = None,
    draw_views: DrawViews | None = None,
    progress: Progress | None = None,
) -> BuildResult:
    """Generate an environment and save it to a folder; nothing is cached.

    Args:
        spec: Origin of the room; any but a `path`, which is an environment already.
        wind: The air's motion and the grid's cell size.
        folder: Target; an environment there is replaced.
        scenario_dir: Base folder of relative paths.
        draw_views: Returns views of it, which are saved beside it; absent: none.
        progress: Receives the current step and its fraction done, from 0 to 1.
    """
    progress = progress or no_progress
    progress("Building the room", 0.0)
    room = build_geometry(spec, wind, scenario_dir=scenario_dir)
    blown = fill_still_air(room) if any(not door.is_open for door in spec.doors) else room
    made = solve_wind_of_scenario(blown, spec, wind, scenario_dir=scenario_dir, progress=progress)
    notices = (*room.notices, *made.notices)
    for notice in notices:
        _log.info(notice)
    environment = with_wind(room, made.frames)
    extras = {} if draw_views is None else dict(draw_views(environment, made.report))
    if made.report is not None:
        extras[REPORT_FILE] = json.dumps(made.report.summary(), indent=2).encode()
    save_environment(environment, folder, made_from=recipe(spec, wind), notices=notices, extras=extras)
    progress("Saving the environment", 1.0)
    return BuildResult(environment=environment, notices=notices)
