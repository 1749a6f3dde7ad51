"""Builder of a layout: an environment with its cells, or all that makes it impossible."""

from dataclasses import dataclass, field
from functools import lru_cache

from gslcosim.environment.errors import raise_if_any
from gslcosim.environment.geometry_model import EnvironmentGeometry, freeze_array
from gslcosim.environment.layouts.layouts import find_layout_problems, plan_layout
from gslcosim.environment.occupancy import build_occupancy, find_occupancy_problems
from gslcosim.scenario.models.scenario import Layout, SolverSpec
from gslcosim.scenario.problems import Problem

# A room is asked for several times on the way to a flight, and by many cases of a family.
_MOST_KEPT = 128


def build_layout(layout: Layout, wind: SolverSpec) -> EnvironmentGeometry:
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


def find_room_problems(layout: Layout, wind: SolverSpec) -> list[Problem]:
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
def _made(recipe: _Recipe) -> tuple[tuple[Problem, ...], EnvironmentGeometry | None]:
    layout, wind = recipe.layout, recipe.wind
    if problems := find_layout_problems(layout, wind):
        return tuple(problems), None
    plan = plan_layout(layout, wind)
    if problems := find_occupancy_problems(plan):
        return tuple(problems), None
    room = EnvironmentGeometry(
        name=plan.name,
        grid=plan.grid,
        occupancy=freeze_array(build_occupancy(plan)),
        boxes=plan.boxes,
        openings=plan.openings,
        notices=plan.notices,
        lights=plan.lights,
    )
    return (), room
