"""Occupancy: which cells of an environment are air, which are solid, and which touch an outlet."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.boxes import voxelize
from gslcosim.environment.flood_fill import reachable_cells
from gslcosim.environment.grid import Grid, point_text
from gslcosim.environment.model import Cell, Opening
from gslcosim.environment.openings import cells_at
from gslcosim.environment.plan import LAYOUT_PATH, GeometryPlan
from gslcosim.scenario.problems import Problem


def build_occupancy(plan: GeometryPlan) -> NDArray[np.uint8]:
    """Return the (nx, ny, nz) cells of a planned room: its boxes, sealed pockets filled, outlets marked.

    Air is what is connected, through faces of cells, with an opening. The rest can neither be flown to nor be blown
    through, so it becomes solid.
    """
    is_solid = voxelize(plan.boxes, plan.grid)
    is_air = find_reachable_cells(~is_solid, plan.openings, plan.grid)
    occupancy = np.where(is_air, np.uint8(Cell.FREE), np.uint8(Cell.SOLID))
    for opening in plan.openings:
        if opening.kind != "inlet":
            layer = occupancy[cells_at(opening, plan.grid)]
            layer[layer == Cell.FREE] = Cell.OUTLET
    return occupancy


def find_reachable_cells(is_open: NDArray[np.bool_], openings: Sequence[Opening], grid: Grid) -> NDArray[np.bool_]:
    """Return the open cells that are connected with an open cell at one of the openings."""
    is_seed = np.zeros(grid.shape, dtype=np.bool_)
    for opening in openings:
        is_seed[cells_at(opening, grid)] = True
    return reachable_cells(is_open, np.argwhere(is_seed & is_open))


def find_occupancy_problems(plan: GeometryPlan) -> list[Problem]:
    """Return what keeps the air from coming in, passing and going out; empty when it can."""
    is_open = ~voxelize(plan.boxes, plan.grid)
    problems = [
        Problem(
            path=_path_to_blame(plan),
            expected=f"air at the {opening.name}, {point_text(opening.min_m)} to {point_text(opening.max_m)} m",
            found="obstacles in front of all of it",
            remedy=f"Move the obstacles or the {opening.name}.",
        )
        for opening in plan.openings
        if not is_open[cells_at(opening, plan.grid)].any()
    ]
    if problems:
        return problems
    inlets = [opening for opening in plan.openings if opening.kind == "inlet"]
    outlets = [opening for opening in plan.openings if opening.kind != "inlet"]
    is_reached = find_reachable_cells(is_open, inlets, plan.grid)
    if inlets and any(not is_reached[cells_at(outlet, plan.grid)].any() for outlet in outlets):
        problems.append(
            Problem(
                path=_path_to_blame(plan),
                expected="a way for the air from the inlet to the outlet, at least one cell wide",
                found=f"obstacles that divide the room; the inlet's part has {int(is_reached.sum())} of "
                f"{int(is_open.sum())} free cells",
                remedy="Leave a gap between the obstacles.",
            )
        )
    return problems


def _path_to_blame(plan: GeometryPlan) -> str:
    return f"{LAYOUT_PATH}.obstacles" if any(box.kind == "obstacle" for box in plan.boxes) else LAYOUT_PATH
