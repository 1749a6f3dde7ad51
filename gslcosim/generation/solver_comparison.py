"""One room solved by the built-in solver and by OpenFOAM: two environments, and how alike their winds are."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from gslcosim.environment.model import Cell, WindFrames
from gslcosim.environment.of_scenario.room_origin import room_of
from gslcosim.environment.room import with_wind
from gslcosim.errors import UsageError
from gslcosim.flow.comparison import SolverComparison, compare_solvers
from gslcosim.generation.making import save_with_views
from gslcosim.generation.recipe_hash import recipe as plain_recipe
from gslcosim.generation.winds import Progress, no_progress, patches_of
from gslcosim.scenario.models.wind import WindSpec
from gslcosim.scenario.recipes import Recipe

JSON_FILE = "solver_comparison.json"
# Compared where the scenario has no end of its own: what GSL-Bench takes for its wind.
DEFAULT_END_S = 5.0


def compare_on(recipe: Recipe, folder: Path, *, progress: Progress | None = None) -> SolverComparison:
    """Solve a room's wind by both solvers and save both environments, and the figures, to a folder.

    The folder then holds `built_in` and `openfoam`, environments with pictures from above, and
    `solver_comparison.json`.

    Args:
        recipe: The room and its wind; without an end of its own the fields after 5 s are compared.
        folder: Where.
        progress: Is told what is being done and how much of it is over, from 0 to 1.

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
    room = room_of(recipe.environment, wind, scenario_dir=recipe.directory)
    compared = compare_solvers(
        room.occupancy != Cell.SOLID,
        room.grid.cell_m,
        patches_of(room, wind),
        end_time_s=wind.end_time_s or DEFAULT_END_S,
        average_from_s=wind.average_from_s,
        turbulence=wind.turbulence,
        progress=lambda done: progress("Solving the wind twice", done),
    )
    for solver, velocity_m_s in (("built_in", compared.built_in_m_s), ("openfoam", compared.openfoam_m_s)):
        made_from = plain_recipe(recipe.environment, wind.model_copy(update={"solver": solver}))
        environment = with_wind(room, WindFrames(velocity_m_s=velocity_m_s[np.newaxis]))
        save_with_views(
            environment, folder / solver, made_from=made_from, notices=room.notices, sources_m=recipe.sources_m
        )
    (folder / JSON_FILE).write_text(json.dumps(fields_of(compared), indent=2), encoding="utf-8")
    return compared


def fields_of(compared: SolverComparison) -> dict[str, Any]:
    """Return the figures of a comparison as plain values."""
    return {
        "built_in_wall_s": compared.built_in_wall_s,
        "openfoam_wall_s": compared.openfoam_wall_s,
        "openfoam_ranks": compared.n_ranks,
        "agreement": asdict(compared.agreement),
    }
