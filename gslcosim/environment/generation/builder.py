"""Builder of environments: geometry, wind, scene and picture into a folder."""

import io
import json
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gslcosim import flow
from gslcosim.base.errors import FlowError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.generation.cache import recipe
from gslcosim.environment.generation.wind import Progress, no_progress, solve_wind_of_scenario
from gslcosim.environment.geometry_source import build_geometry
from gslcosim.environment.model import Environment, with_wind
from gslcosim.environment.picture import top_view_png
from gslcosim.environment.scene_file import build_mjcf
from gslcosim.environment.store import HISTORY_FILE, PICTURE_FILE, REPORT_FILE, SCENE_FILE, save_environment
from gslcosim.environment.variants import fill_still_air
from gslcosim.scenario.models.scenario import EnvironmentSpec, SolverSpec

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
    sources_m: Sequence[Vec3] = (),
    progress: Progress | None = None,
) -> BuildResult:
    """Generate an environment and save it to a folder, with its scene and a picture from above; nothing is cached.

    Args:
        spec: Origin of the room; any but a `path`, which is an environment already.
        wind: The air's motion and the grid's cell size.
        folder: Target; an environment there is replaced.
        scenario_dir: Base folder of relative paths.
        sources_m: Sources of gas to show in the picture, world frame [m].
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
    save_with_scene_and_picture(
        environment,
        folder,
        made_from=recipe(spec, wind),
        notices=notices,
        sources_m=sources_m,
        extras=_report_files(made.report),
    )
    progress("Saving the environment", 1.0)
    return BuildResult(environment=environment, notices=notices)


def save_with_scene_and_picture(
    environment: Environment,
    folder: Path,
    *,
    made_from: Mapping[str, Any],
    notices: Sequence[str],
    sources_m: Sequence[Vec3] = (),
    extras: Mapping[str, bytes] | None = None,
) -> None:
    """Save an environment with its scene for other programs and its picture for people.

    Args:
        environment: The environment.
        folder: Target; an environment there is replaced.
        made_from: Its recipe.
        notices: Notices about it.
        sources_m: Sources of gas to show in the picture, world frame [m].
        extras: Further files by name.
    """
    views = {
        SCENE_FILE: build_mjcf(environment).encode(),
        PICTURE_FILE: top_view_png(environment, sources_m=sources_m),
    }
    save_environment(environment, folder, made_from=made_from, notices=notices, extras={**views, **(extras or {})})


# The solver's report: figures, and a plot where the extra for plots is installed.
def _report_files(report: flow.WindReport | None) -> dict[str, bytes]:
    if report is None:
        return {}
    files = {REPORT_FILE: json.dumps(report.summary(), indent=2).encode()}
    picture = io.BytesIO()
    try:
        flow.plot_history(report, picture)
    except FlowError:
        return files
    return {**files, HISTORY_FILE: picture.getvalue()}
