"""From a layout to a room with its cells, or to all that makes it impossible."""

from gslcosim.environment.layouts.kinds import plan_room, problems_of_layout
from gslcosim.environment.occupancy import occupancy_of, problems_of_occupancy
from gslcosim.environment.problems import raise_if_any
from gslcosim.environment.room import Room, frozen
from gslcosim.scenario.models.scenario import Layout, SolverSpec
from gslcosim.scenario.problems import Problem


def build_room(layout: Layout, wind: SolverSpec) -> Room:
    """Generate a room from its layout, without solving its wind.

    Args:
        layout: What the scenario says of the room.
        wind: Gives the cell of the grid and the velocity at the inlet.

    Raises:
        ScenarioError: the layout is impossible; the text lists all reasons.
    """
    plan = plan_room(layout, wind)
    raise_if_any(problems_of_occupancy(plan))
    return Room(
        name=plan.name,
        grid=plan.grid,
        occupancy=frozen(occupancy_of(plan)),
        boxes=plan.boxes,
        openings=plan.openings,
        notices=plan.notices,
        lights=plan.lights,
    )


def problems_of_room(layout: Layout, wind: SolverSpec) -> list[Problem]:
    """Return all that makes a room impossible, with the places in the scenario; empty when it can be built."""
    return problems_of_layout(layout, wind) or problems_of_occupancy(plan_room(layout, wind))
