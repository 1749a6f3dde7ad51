"""Views in an environment's folder: its scene for other programs, and pictures of room and wind for people."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.errors import FlowError
from gslcosim.base.quantities import Vec3
from gslcosim.environment.model import Environment
from gslcosim.environment.store import save_environment
from gslcosim.flow import WindReport
from gslcosim_formats.plan_pictures import top_view_png
from gslcosim_formats.scene_file import SCENE_FILE, build_mjcf
from gslcosim_formats.wind_plots import plot_history

PICTURE_FILE, HISTORY_FILE = "top_view.png", "wind_history.png"


def draw_views(
    environment: Environment, report: WindReport | None = None, *, sources_m: Sequence[Vec3] = ()
) -> dict[str, bytes]:
    """Return the scene of an environment, its picture from above, and a plot of its solve: files by name.

    Args:
        environment: The environment.
        report: Report of its wind, if that was solved; the plot also needs matplotlib.
        sources_m: Sources of gas to show in the picture, world frame [m].
    """
    views = {
        SCENE_FILE: build_mjcf(environment).encode(),
        PICTURE_FILE: top_view_png(environment, sources_m=sources_m),
    }
    if report is None:
        return views
    plot = io.BytesIO()
    try:
        plot_history(report, plot)
    except FlowError:
        return views
    return {**views, HISTORY_FILE: plot.getvalue()}


def save_with_views(
    environment: Environment,
    folder: Path,
    *,
    made_from: Mapping[str, Any],
    notices: Sequence[str],
    sources_m: Sequence[Vec3] = (),
) -> None:
    """Save an environment with its scene for other programs and its picture for people.

    Args:
        environment: The environment.
        folder: Target; an environment there is replaced.
        made_from: Its recipe.
        notices: Notices about it.
        sources_m: Sources of gas to show in the picture, world frame [m].
    """
    views = draw_views(environment, sources_m=sources_m)
    save_environment(environment, folder, made_from=made_from, notices=notices, extras=views)
