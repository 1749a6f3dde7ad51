"""Comparison of the built-in solver with OpenFOAM in one environment, and how alike their winds are."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.base.errors import UsageError
from gslcosim.environment.build.geometry_source import build_geometry
from gslcosim.environment.generation.builder import save_with_scene_and_picture
from gslcosim.environment.generation.recipe_hash import recipe as plain_recipe
from gslcosim.environment.generation.wind import Progress, build_patches, no_progress
from gslcosim.environment.geometry_model import with_wind
from gslcosim.environment.model import Cell, WindFrames
from gslcosim.flow.comparison import SolverComparison, compare_solvers
from gslcosim.scenario.models.wind import WindSpec
from gslcosim.scenario.recipes import Recipe

JSON_FILE = "solver_comparison.json"
# Compared where the scenario has no end of its own: what GSL-Bench takes for its wind.
DEFAULT_END_S = 5.0


def compare_solvers_in(recipe: Recipe, folder: Path, *, progress: Progress | None = None) -> SolverComparison:
    """Solve a room's wind by both solvers and save both environments, and the figures, to a folder.

    The folder then holds `built_in` and `openfoam`, environments with pictures from above, and
    `solver_comparison.json`.

    Args:
        recipe: The room and its wind; without an end of its own the fields after 5 s are compared.
        folder: Where.
        progress: Receives what is being done and how much of it is over, from 0 to 1.

    Raises:
        UsageError: the wind changes in time.
        ScenarioError: the room is impossible.
        FlowError: there is no OpenFOAM, or one of both failed.
    """
    wind, progress = recipe.wind, progress or no_progress
    if not isinstance(wind, WindSpec):
        raise UsageError(f"--compare-solvers: expected one of gslcosim's own solvers, was {wind.solver}.")
    if wind.save_every_s is not None:
        raise UsageError("--compare-solvers: expected one wind to compare, was wind.save_every_s. Leave it out.")
    room = build_geometry(recipe.environment, wind, scenario_dir=recipe.directory)
    compared = compare_solvers(
        room.occupancy != Cell.SOLID,
        room.grid.cell_m,
        build_patches(room, wind),
        end_time_s=wind.end_time_s or DEFAULT_END_S,
        average_from_s=wind.average_from_s,
        turbulence=wind.turbulence,
        progress=lambda done: progress("Solving the wind twice", done),
    )
    for solver, velocity_m_s in (("built_in", compared.built_in_m_s), ("openfoam", compared.openfoam_m_s)):
        made_from = plain_recipe(recipe.environment, wind.model_copy(update={"solver": solver}))
        environment = with_wind(room, WindFrames(velocity_m_s=velocity_m_s[np.newaxis]))
        save_with_scene_and_picture(
            environment, folder / solver, made_from=made_from, notices=room.notices, sources_m=recipe.sources_m
        )
    (folder / JSON_FILE).write_text(json.dumps(comparison_to_json(compared), indent=2), encoding="utf-8")
    return compared


def comparison_to_json(compared: SolverComparison) -> dict[str, Any]:
    """Return the figures of a comparison as plain values."""
    return {
        "built_in_wall_s": compared.built_in_wall_s,
        "openfoam_wall_s": compared.openfoam_wall_s,
        "openfoam_ranks": compared.n_ranks,
        "agreement": asdict(compared.agreement),
    }
