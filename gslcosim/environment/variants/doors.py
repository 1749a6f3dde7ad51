"""Doors: boxes that are solid while they are closed, and gone while they are open."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gslcosim.environment.boxes import voxelize
from gslcosim.environment.geometry_model import EnvironmentGeometry
from gslcosim.environment.grid import point_text
from gslcosim.environment.model import Box, Cell, Environment
from gslcosim.environment.openings import cells_at
from gslcosim.environment.variants.door_boxes import DOOR_RGBA, door_box
from gslcosim.scenario.models.layouts import DoorSpec
from gslcosim.scenario.problems import Problem

DOORS_PATH = "environment.doors"


def add_closed_doors(room: EnvironmentGeometry, doors: Sequence[DoorSpec]) -> EnvironmentGeometry:
    """Return a room in which the doors that are not open stand.

    Air that a closed door cuts off from all openings stays air: the door may open again.

    Args:
        room: The room with all its doors open.
        doors: Its doors.
    """
    boxes = tuple(door_box(door) for door in doors if not door.is_open)
    if not boxes:
        return room
    occupancy = np.where(voxelize(boxes, room.grid), np.uint8(Cell.SOLID), room.occupancy)
    return replace(room, occupancy=occupancy, boxes=(*room.boxes, *boxes))


def fill_still_air(room: EnvironmentGeometry) -> EnvironmentGeometry:
    """Return a room for wind: what no opening reaches is solid, as the air stands still there.

    Solvers find no pressure in a part of the room that neither takes air in nor lets it out.
    """
    if not room.openings:
        return room
    from gslcosim.environment.occupancy import find_reachable_cells  # compiles, and most rooms have no doors

    is_reached = find_reachable_cells(room.occupancy != Cell.SOLID, room.openings, room.grid)
    return replace(room, occupancy=np.where(is_reached, room.occupancy, np.uint8(Cell.SOLID)))


def find_door_boxes(environment: Environment) -> tuple[Box, ...]:
    """Return the boxes that are there in some situations of a run and not in others, in the order of their names."""
    rooms = (environment, *environment.later_rooms.values())
    boxes = {box.name: box for room in rooms for box in room.boxes}
    always = set(boxes).intersection(*({box.name for box in room.boxes} for room in rooms))
    return tuple(boxes[name] for name in sorted(set(boxes) - always))


def find_door_problems(room: EnvironmentGeometry, doors: Sequence[DoorSpec]) -> list[Problem]:
    """Return what is wrong with doors in a room; empty when all can be opened and closed.

    Args:
        room: The room with all its doors open.
        doors: Its doors.
    """
    problems: list[Problem] = []
    names = {box.name for box in room.boxes}
    for i, door in enumerate(doors):
        if door.name in names:
            problems.append(
                Problem(
                    path=f"{DOORS_PATH}[{i}].name",
                    expected="a name that no other door or box of the room has",
                    found=f"'{door.name}'",
                    remedy=f"For example {door.name}_{i + 1}.",
                )
            )
        names.add(door.name)
        if problem := _problem_of_place(room, door, f"{DOORS_PATH}[{i}]"):
            problems.append(problem)
    return problems


def find_cut_off_openings(room: EnvironmentGeometry, path: str) -> list[Problem]:
    """Return a problem for each opening of a room that its closed doors cut off from the inlets.

    Args:
        room: The room with the doors as they are.
        path: What of the scenario is to blame.
    """
    is_air = room.occupancy != Cell.SOLID
    inlets = [opening for opening in room.openings if opening.kind == "inlet"]
    from gslcosim.environment.occupancy import find_reachable_cells  # compiles, and most rooms have no doors

    is_reached = find_reachable_cells(is_air, inlets, room.grid)
    return [
        Problem(
            path=path,
            expected=f"a way for the air from the inlet to the {opening.name}, whichever doors are closed",
            found=f"none with {', '.join(_closed_in(room))} closed",
            remedy="Move the door, or add openings to environment.layout.",
        )
        for opening in room.openings
        if inlets and not is_reached[cells_at(opening, room.grid)].any()
    ]


def _closed_in(room: EnvironmentGeometry) -> list[str]:
    return [box.name for box in room.boxes if box.rgba == DOOR_RGBA]


def _problem_of_place(room: EnvironmentGeometry, door: DoorSpec, path: str) -> Problem | None:
    low_m, high_m = room.grid.origin_m, room.grid.max_m
    corners = f"{point_text(door.min_m)} to {point_text(door.max_m)} m"
    if any(
        a < low - 1e-9 or b > high + 1e-9 for a, b, low, high in zip(door.min_m, door.max_m, low_m, high_m, strict=True)
    ):
        return Problem(
            path=path,
            expected=f"a door inside the room, which reaches from {point_text(low_m)} to {point_text(high_m)} m",
            found=corners,
            remedy="Move it, or cut it to the room.",
        )
    is_door = voxelize([door_box(door)], room.grid)
    if (room.occupancy[is_door] == Cell.SOLID).all():
        return Problem(
            path=path,
            expected="a door that closes a gap: at least one cell of air in it",
            found=f"{corners}, which is solid without it",
            remedy="Leave a gap in the wall where the door is.",
        )
    return None
