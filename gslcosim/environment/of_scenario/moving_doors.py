"""Doors that close on something, and events that would need too many rooms."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gslcosim.environment.door_boxes import door_box
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.room import Room
from gslcosim.environment.situations import situations_of
from gslcosim.environment.voxels import voxelize
from gslcosim.scenario.models.event_kinds import DoorClosesSpec, SourceMovesSpec
from gslcosim.scenario.models.scenario import Scenario, VehicleSpec
from gslcosim.scenario.problems import Problem

MOST_SITUATIONS = 16


def problems_of_moving_doors(scenario: Scenario, room: Room | Environment) -> Iterator[Problem]:
    """Yield what is wrong with the events of a scenario's doors in its room.

    A door may not close on a vehicle's start or on a source, and events may not make more than `MOST_SITUATIONS` rooms.
    """
    n_situations = len(situations_of(scenario))
    if n_situations > MOST_SITUATIONS:
        yield Problem(
            path="events",
            expected=f"at most {MOST_SITUATIONS} combinations of closed doors and inlets, each of which is a room",
            found=f"{n_situations}",
            remedy="Give the events of doors and wind times (at_s): then only those that follow each other count.",
        )
    doors = {door.name: door_box(door) for door in scenario.environment.doors}
    for i, event in enumerate(scenario.events):
        if not isinstance(event, DoorClosesSpec) or event.door not in doors:
            continue
        hits = _hits(scenario, room, doors[event.door])
        if hits:
            yield Problem(
                path=f"events[{i}].door",
                expected="a door that closes on no vehicle's start and on no source",
                found=f"{event.door}, which closes on {' and '.join(hits)}",
                remedy=f"Move the door, or {hits[0]}.",
            )


def _hits(scenario: Scenario, room: Room | Environment, door: Box) -> list[str]:
    is_door = voxelize([door], room.grid)
    places = [(f"gas.sources[{i}].position_m", source.position_m) for i, source in enumerate(scenario.gas.sources)]
    places += [
        (f"events[{i}].to_m", event.to_m)
        for i, event in enumerate(scenario.events)
        if isinstance(event, SourceMovesSpec)
    ]
    cells = [(path, room.grid.cell_of(np.asarray(place_m))) for path, place_m in places]
    hits = [path for path, cell in cells if room.grid.contains_cell(cell) and is_door[tuple(cell)]]
    alone = replace(room, boxes=(door,))
    starts = [(f"agents[{i}].vehicle.start_m", agent.vehicle) for i, agent in enumerate(scenario.agents)]
    return hits + [path for path, each in starts if boxes_in_the_way(np.asarray([each.start_m]), each, alone)[0]]


def boxes_in_the_way(starts_m: NDArray[np.float64], vehicle: VehicleSpec, room: Room | Environment) -> list[list[str]]:
    """Return the names of the boxes, except the floor, that reach into the column from each start up to search height.

    Args:
        starts_m: (n, 3) places, world frame [m].
        vehicle: What would start there.
        room: The room.
    """
    body = vehicle.facts.body
    radius_m, half_height_m = body.radius_m, body.half_height_m
    # A search height above the ceiling is another problem.
    search_height_m = min(vehicle.search_height_m, room.grid.max_m[2] - radius_m)
    bottom_m = starts_m[:, 2]
    top_m = np.maximum(bottom_m, search_height_m) + half_height_m
    hits: list[list[str]] = [[] for _ in starts_m]
    for box in (box for box in room.boxes if box.kind != "floor"):
        low, high = np.asarray(box.min_m), np.asarray(box.max_m)
        beside_m = np.maximum(np.maximum(low[:2] - starts_m[:, :2], starts_m[:, :2] - high[:2]), 0.0)
        is_near = np.hypot(beside_m[:, 0], beside_m[:, 1]) < radius_m - 1e-9
        # What ends below the start carries the vehicle; only what rises above it is in the way.
        for i in np.flatnonzero(is_near & (high[2] > bottom_m + 1e-9) & (low[2] < top_m)):
            hits[i].append(box.name)
    return hits
