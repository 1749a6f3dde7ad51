"""Variants of an environment during a run: doors that open and close, and winds that events bring."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import ModelError
from gslcosim.base.problems import Problem
from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract.environment_messages import WIND, WindShare
from gslcosim.contract.participant import Inbox
from gslcosim.environment.model import (
    OWN_WIND,
    Box,
    Cell,
    Closed,
    Environment,
    EnvironmentGeometry,
    EnvironmentVariant,
    freeze_array,
    span_text,
)
from gslcosim.environment.openings import cells_at, voxelize
from gslcosim.scenario.models.events import DoorClosesSpec, DoorOpensSpec, EventSpec, WindChangesSpec
from gslcosim.scenario.models.geometry import DoorSpec
from gslcosim.scenario.models.scenario import Scenario, find_due_events

DOORS_PATH = "environment.doors"
DOOR_RGBA = (0.55, 0.36, 0.20, 1.0)


def door_box(door: DoorSpec) -> Box:
    """Return the box of a closed door."""
    return Box(name=door.name, kind="obstacle", min_m=door.min_m, max_m=door.max_m, rgba=DOOR_RGBA)


def add_closed_doors(room: EnvironmentGeometry, doors: Sequence[DoorSpec]) -> EnvironmentGeometry:
    """Return a room with the boxes of its closed doors.

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
    """Return a room for a wind solver: still air, out of reach of all openings, becomes solid.

    Solvers find no pressure in a part of the room without inlet and outlet.
    """
    if not room.openings:
        return room
    from gslcosim.environment.grid_kernels import find_reachable_cells  # compiles, and most rooms have no doors

    is_reached = find_reachable_cells(room.occupancy != Cell.SOLID, room.openings, room.grid)
    return replace(room, occupancy=np.where(is_reached, room.occupancy, np.uint8(Cell.SOLID)))


def find_door_boxes(environment: Environment) -> tuple[Box, ...]:
    """Return the boxes of doors that move: those in some variants but not in all, in the order of their names."""
    rooms = (environment, *environment.later_rooms.values())
    boxes = {box.name: box for room in rooms for box in room.boxes}
    always = set(boxes).intersection(*({box.name for box in room.boxes} for room in rooms))
    return tuple(boxes[name] for name in sorted(set(boxes) - always))


def find_door_problems(room: EnvironmentGeometry, doors: Sequence[DoorSpec]) -> list[Problem]:
    """Return the problems of doors in a room.

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
                    where=f"{DOORS_PATH}[{i}].name",
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
        room: The room with its closed doors.
        path: Place of the problems in the scenario.
    """
    is_air = room.occupancy != Cell.SOLID
    inlets = [opening for opening in room.openings if opening.kind == "inlet"]
    from gslcosim.environment.grid_kernels import find_reachable_cells  # compiles, and most rooms have no doors

    is_reached = find_reachable_cells(is_air, inlets, room.grid)
    closed = ", ".join(box.name for box in room.boxes if box.rgba == DOOR_RGBA)
    return [
        Problem(
            where=path,
            expected=f"a way for the air from the inlet to the {opening.name}, whichever doors are closed",
            found=f"none with {closed} closed",
            remedy="Move the door, or add openings to environment.layout.",
        )
        for opening in room.openings
        if inlets and not is_reached[cells_at(opening, room.grid)].any()
    ]


def _problem_of_place(room: EnvironmentGeometry, door: DoorSpec, path: str) -> Problem | None:
    low_m, high_m = room.grid.origin_m, room.grid.max_m
    corners = span_text(door.min_m, door.max_m)
    if any(
        a < low - 1e-9 or b > high + 1e-9 for a, b, low, high in zip(door.min_m, door.max_m, low_m, high_m, strict=True)
    ):
        return Problem(
            where=path,
            expected=f"a door inside the room, which reaches from {span_text(low_m, high_m)}",
            found=corners,
            remedy="Move it, or cut it to the room.",
        )
    is_door = voxelize([door_box(door)], room.grid)
    if (room.occupancy[is_door] == Cell.SOLID).all():
        return Problem(
            where=path,
            expected="a door that closes a gap: at least one cell of air in it",
            found=f"{corners}, which is solid without it",
            remedy="Leave a gap in the wall where the door is.",
        )
    return None


def variant_after(variant: EnvironmentVariant, i_event: int, event: EventSpec) -> EnvironmentVariant:
    """Return the variant after an event of a scenario; the same for an event without effect on room and wind."""
    closed, i_wind = variant
    match event:
        case DoorOpensSpec():
            return EnvironmentVariant(tuple(name for name in closed if name != event.door), i_wind)
        case DoorClosesSpec():
            return EnvironmentVariant(tuple(sorted({*closed, event.door})), i_wind)
        case WindChangesSpec():
            return EnvironmentVariant(closed, OWN_WIND if event.inlet_velocity_m_s is None else i_event)
        case _:
            return variant


def first_variant(scenario: Scenario) -> EnvironmentVariant:
    """Return the variant at the start of a run."""
    return EnvironmentVariant(
        closed=tuple(sorted(door.name for door in scenario.environment.doors if not door.is_open))
    )


def find_variants(scenario: Scenario) -> list[EnvironmentVariant]:
    """Return all variants that a run may reach, that at its start first.

    Events with times follow each other; if any has a condition instead, all orders are possible.
    """
    first = first_variant(scenario)
    mattering = [(i, event) for i, event in enumerate(scenario.events) if event.drives_wind]
    if all(event.at_s is not None for _, event in mattering):
        mattering.sort(key=lambda item: ticks_from_seconds(item[1].at_s or 0.0, scenario.tick_ns))
        each_after = accumulate(mattering, lambda variant, event: variant_after(variant, *event), initial=first)
        return list(dict.fromkeys(each_after))
    found = {first: None}
    waiting = [first]
    while waiting:
        variant = waiting.pop()
        for i, event in mattering:
            later = variant_after(variant, i, event)
            if later not in found:
                found[later] = None
                waiting.append(later)
    return list(found)


def variant_scenarios(scenario: Scenario) -> list[Scenario]:
    """Return the scenario, and for each further set of closed doors a scenario that starts with it."""
    first, *later = find_variants(scenario)
    rooms = {each.closed: scenario_in_variant(scenario, each) for each in later if each.closed != first.closed}
    return [scenario, *rooms.values()]


def scenario_in_variant(scenario: Scenario, variant: EnvironmentVariant) -> Scenario:
    """Return the scenario that starts with the room and wind of a variant."""
    doors = tuple(
        door.model_copy(update={"is_open": door.name not in variant.closed}) for door in scenario.environment.doors
    )
    wind = scenario.wind
    if variant.i_wind != OWN_WIND:
        event = scenario.events[variant.i_wind]
        assert isinstance(event, WindChangesSpec), "only such an event brings a wind"
        wind = wind.model_copy(update={"inlet_velocity_m_s": event.inlet_velocity_m_s})
    environment = scenario.environment.model_copy(update={"doors": doors})
    return scenario.model_copy(update={"environment": environment, "wind": wind})


class DynamicEnvironment:
    """The room of a scenario in its current variant.

    Each participant with an instance applies events to it, so that all of them switch in the same tick.

    Attributes:
        rooms: Rooms by variant.
        variant: Current variant, the only state.
    """

    def __init__(self, environment: Environment, scenario: Scenario) -> None:
        """Set the variant at the start of a run."""
        self._scenario = scenario
        self._first, *later = find_variants(scenario)
        lacking = [each for each in later if each not in environment.later_rooms]
        if lacking:
            raise ModelError(f"environment: expected the room that events bring with {_text(lacking[0])}, found none.")
        self.rooms = {self._first: environment, **{each: environment.later_rooms[each] for each in later}}
        self.variant = self._first

    @property
    def now(self) -> Environment:
        """Current room and wind."""
        return self.rooms[self.variant]

    def by_doors(self) -> dict[Closed, Environment]:
        """Return a room of any wind for each set of closed doors, that at the start first."""
        rooms: dict[Closed, Environment] = {}
        for variant, room in self.rooms.items():
            rooms.setdefault(variant.closed, room)
        return rooms

    def reset(self) -> None:
        """Return to the variant at the start of a run."""
        self.variant = self._first

    def obey(self, inbox: Inbox) -> bool:
        """Apply the events of this tick, and return whether a door has moved."""
        closed = self.variant.closed
        for i, event in find_due_events(self._scenario, inbox):
            self.variant = variant_after(self.variant, i, event)
        return self.variant.closed != closed


def _text(variant: EnvironmentVariant) -> str:
    doors = f"{', '.join(variant.closed) or 'no door'} closed"
    return doors if variant.i_wind == OWN_WIND else f"{doors} and the wind of events[{variant.i_wind}]"


class ScaledWind:
    """A room's frames of wind times a factor, the share of `WindShare`, 1 until it is set.

    u(x, t) = share(t) u_frame(x, t)
    [m/s] = [1] [m/s]

    Our derivation: without viscosity the equations of motion stay the same when all velocities are multiplied by a
    factor and times divided by it, so a flow at a high Reynolds number keeps its shape. The transient is neglected.
    The factor is that of a service times that of the last wind event. The frames are those of the current variant:
    the room's own, or those of the event's inlet, with the present doors.
    Arrays are read-only and valid until factor, frames or frame change.
    """

    def __init__(self, environment: Environment, scenario: Scenario) -> None:
        """Start with the room's own wind."""
        self._scenario = scenario
        self.room = DynamicEnvironment(environment, scenario)
        self._frames = {
            variant: freeze_array(np.asarray(room.wind.velocity_m_s).view())
            for variant, room in self.room.rooms.items()
        }
        self._share = self._event_share = 1.0
        self._scaled: tuple[EnvironmentVariant, int, float] | None = None
        self._scaled_m_s = np.zeros(0, np.float32)

    def reset(self) -> None:
        """Return to the room's own wind."""
        self.room.reset()
        self._share = self._event_share = 1.0

    def obey(self, inbox: Inbox) -> bool:
        """Apply the service's message and the events of this tick, and return whether a door has moved."""
        message = inbox.get(WIND)
        if isinstance(message, WindShare):
            self._share = message.share
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, WindChangesSpec):
                self._event_share = event.share
        return self.room.obey(inbox)

    def at(self, time_s: float) -> NDArray[np.float32]:
        """Return the wind at a time [s], (nx, ny, nz, 3), cell centres, world frame [m/s]."""
        variant, share = self.room.variant, self._share * self._event_share
        i_frame = self.room.now.wind.frame_at(time_s)
        frame_m_s = self._frames[variant][i_frame]
        if share == 1.0:
            return frame_m_s
        if self._scaled != (variant, i_frame, share):
            self._scaled = (variant, i_frame, share)
            self._scaled_m_s = freeze_array(np.asarray(frame_m_s * np.float32(share), np.float32))
        return self._scaled_m_s
