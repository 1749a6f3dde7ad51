"""A room on paper: what a layout comes to before its cells are filled."""

from dataclasses import dataclass

from gslcosim.environment.grid import Grid
from gslcosim.environment.model import Box, Light, Opening

LAYOUT_PATH = "environment.layout"
# More cells than this would not fit into the memory of a common machine together with the solver's fields.
MAX_CELLS = 200_000_000


@dataclass(frozen=True, kw_only=True)
class RoomPlan:
    """A room on paper: where its air, its solids and its openings are.

    `grid` covers exactly the air, from the corner (0, 0, 0) to the layout's `size_m`; walls, floor and ceiling lie
    outside it. Openings are whole cells; walls are closed behind them, so that no vehicle leaves the room.
    `notices` are sentences on what was done differently from what the layout says.
    """

    name: str
    grid: Grid
    boxes: tuple[Box, ...]
    openings: tuple[Opening, ...]
    notices: tuple[str, ...] = ()
    lights: tuple[Light, ...] = ()
