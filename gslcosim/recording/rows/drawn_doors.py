"""Doors in the recording: boxes that are there while they are closed, in the room and on the map."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from gslcosim.contract.participant import Inbox
from gslcosim.environment.doors import boxes_of_doors
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.room_in_time import RoomInTime
from gslcosim.recording import colors, entities
from gslcosim.recording.rows.columns import MarkerRows, Rows
from gslcosim.recording.run_file import RunFile
from gslcosim.recording.scene import door_look, flat_box
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import due_events
from gslcosim.scenario.models.event_kinds import DoorEventSpec

_MARK_RADIUS_M = 0.06


class DoorRows:
    """A box over time: a row with it wherever it is closed, one without wherever it opens."""

    def __init__(self, entity: str, box: Box) -> None:
        self._entity = entity
        self._box = box
        self._ticks: list[int] = []
        self._are_closed: list[bool] = []

    def draw(self, file: RunFile) -> None:
        """Draw how it looks while it is closed."""
        file.draw(self._entity, door_look(self._box))

    def add(self, tick: int, *, is_closed: bool) -> None:
        """Take note that it is closed, or open, from a tick on."""
        self._ticks.append(tick)
        self._are_closed.append(is_closed)

    def send(self, file: RunFile) -> None:
        """Write the waiting rows, if any, and forget them."""
        if not self._ticks:
            return
        low_m, high_m = np.array(self._box.min_m), np.array(self._box.max_m)
        n_closed = sum(self._are_closed)
        columns = rr.Boxes3D.columns(
            centers=np.tile((low_m + high_m) / 2, (n_closed, 1)),
            half_sizes=np.tile((high_m - low_m) / 2, (n_closed, 1)),
        )
        file.send(self._entity, self._ticks, columns.partition([int(is_closed) for is_closed in self._are_closed]))
        self._ticks, self._are_closed = [], []


class DrawnDoors:
    """All doors of a run, with a mark in the room for each event that moves one."""

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        self._scenario = scenario
        self._room = RoomInTime(environment, scenario)
        self._boxes = {box.name: box for box in boxes_of_doors(environment)}
        height_m = scenario.slice_height_m
        self._rows = {
            name: (
                DoorRows(f"{entities.DOORS}/{name}", box),
                *(
                    (DoorRows(f"map/doors/{name}", flat_box(environment, box, height_m)),)
                    if box.min_m[2] <= height_m < box.max_m[2]
                    else ()
                ),
            )
            for name, box in self._boxes.items()
        }
        self._marks = {
            name: MarkerRows(f"{entities.DOORS}/{name}/events", radius_m=_MARK_RADIUS_M) for name in self._boxes
        }

    @property
    def room(self) -> RoomInTime:
        """The room as it is now."""
        return self._room

    def draw(self, file: RunFile) -> None:
        """Draw how doors look, and note which are closed at the start."""
        for name, all_rows in self._rows.items():
            for rows in all_rows:
                rows.draw(file)
                rows.add(0, is_closed=name in self._room.situation.closed)

    def add(self, tick: int, inbox: Inbox) -> None:
        """Take note of the doors that move in a tick."""
        if self._room.obey(inbox):
            for name, all_rows in self._rows.items():
                for rows in all_rows:
                    rows.add(tick, is_closed=name in self._room.situation.closed)
        for _, event in due_events(self._scenario, inbox):
            if isinstance(event, DoorEventSpec) and event.door in self._boxes:
                box = self._boxes[event.door]
                x_m, y_m = ((box.min_m[axis] + box.max_m[axis]) / 2 for axis in (0, 1))
                self._marks[event.door].add(tick, (x_m, y_m, box.max_m[2]), event.text, colors.READING)

    def all(self) -> Sequence[Rows]:
        """Return all rows."""
        return [*(rows for all_rows in self._rows.values() for rows in all_rows), *self._marks.values()]
