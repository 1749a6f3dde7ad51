"""From a layout to a room with its cells, or to all that makes it impossible."""

from dataclasses import dataclass, field
from functools import lru_cache

from gslcosim.environment.layouts.kinds import plan_room, problems_of_layout
from gslcosim.environment.occupancy import occupancy_of, problems_of_occupancy
from gslcosim.environment.problems import raise_if_any
from gslcosim.environment.room import Room, frozen
from gslcosim.scenario.models.scenario import Layout, SolverSpec
from gslcosim.scenario.problems import Problem

# A room is asked for several times on the way to a flight, and by many cases of a family.
_MOST_KEPT = 128


def build_room(layout: Layout, wind: SolverSpec) -> Room:
    """Generate a room from its layout, without solving its wind.

    Args:
        layout: What the scenario says of the room.
        wind: Gives the cell of the grid and the velocity at the inlet.

    Raises:
        ScenarioError: the layout is impossible; the text lists all reasons.
    """
    problems, room = _made(_Recipe.of(layout, wind))
    raise_if_any(list(problems))
    assert room is not None, "a room without problems is made"
    return room


def problems_of_room(layout: Layout, wind: SolverSpec) -> list[Problem]:
    """Return all that makes a room impossible, with the places in the scenario; empty when it can be built."""
    return list(_made(_Recipe.of(layout, wind))[0])


@dataclass(frozen=True)
class _Recipe:
    text: str
    layout: Layout = field(compare=False)
    wind: SolverSpec = field(compare=False)

    @classmethod
    def of(cls, layout: Layout, wind: SolverSpec) -> "_Recipe":
        return cls(f"{layout.model_dump_json()}\n{wind.model_dump_json()}", layout, wind)


@lru_cache(_MOST_KEPT)
def _made(recipe: _Recipe) -> tuple[tuple[Problem, ...], Room | None]:
    layout, wind = recipe.layout, recipe.wind
    if problems := problems_of_layout(layout, wind):
        return tuple(problems), None
    plan = plan_room(layout, wind)
    if problems := problems_of_occupancy(plan):
        return tuple(problems), None
    room = Room(
        name=plan.name,
        grid=plan.grid,
        occupancy=frozen(occupancy_of(plan)),
        boxes=plan.boxes,
        openings=plan.openings,
        notices=plan.notices,
        lights=plan.lights,
    )
    return (), room
