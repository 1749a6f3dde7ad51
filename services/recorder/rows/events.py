"""Rows of events: contacts of vehicles, marks of a scenario's events, and doors that open and close."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import rerun as rr

from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.messages import BodyState
from gslcosim.contract.participant import Inbox
from gslcosim.environment.model import Box, Environment
from gslcosim.environment.variants.doors import find_door_boxes
from gslcosim.environment.variants.dynamic_environment import DynamicEnvironment
from gslcosim.scenario import Scenario
from gslcosim.scenario.due_events import find_due_events
from gslcosim.scenario.models.events import DoorEventSpec, SourceEventSpec, SourceMovesSpec
from gslcosim_services.recorder import colors, entities
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.agents import AgentRows
from gslcosim_services.recorder.rows.columns import MarkerRows, Rows, TextRows
from gslcosim_services.recorder.scene import door_look, flat_box


class ContactRows:
    """Contacts of one vehicle: lines of a log with their duration, and points where they began.

    The log has every one. Points are where the vehicle was when it came against something else than a floor, the first
    one of each thing with its name.
    """

    def __init__(self, agent: str, markers: MarkerRows, log: TextRows, *, tick_ns: int, floors: Iterable[str]) -> None:
        self._agent = agent
        self._markers = markers
        self._log = log
        self._tick_ns = tick_ns
        self._floors = frozenset(floors)
        self._since: dict[str, int] = {}
        self._named: set[str] = set()

    def add(self, tick: int, body: BodyState) -> None:
        """Take note of what a vehicle touches at the end of a tick."""
        if not body.contacts and not self._since:
            return
        for thing in body.contacts:
            if thing not in self._since:
                self._begin(tick, body, thing)
        for thing in [thing for thing in self._since if thing not in body.contacts]:
            lasted_s = seconds_from_ticks(tick - self._since.pop(thing), self._tick_ns)
            self._log.add(tick, f"{self._agent} is off {thing} after {lasted_s:g} s", "INFO")

    def _begin(self, tick: int, body: BodyState, thing: str) -> None:
        self._since[thing] = tick
        is_floor = thing in self._floors
        self._log.add(tick, f"{self._agent} touches {thing}", "INFO" if is_floor else "WARN")
        if not is_floor:
            label = "" if thing in self._named else f"touches {thing}"
            self._named.add(thing)
            self._markers.add(tick, body.position_world_m, label, colors.CONTACT)


_SOURCE_RADIUS_M = 0.14


class EventMarkRows:
    """Points with the words of what has happened there; events that are nowhere in the room have none."""

    def __init__(self, scenario: Scenario, agents: Mapping[str, AgentRows]) -> None:
        self._scenario = scenario
        self._agents = agents
        self._places_m = [source.position_m for source in scenario.gas.sources]
        self._sources = [MarkerRows(entity, radius_m=_SOURCE_RADIUS_M) for entity in entities.source_events(scenario)]

    def add(self, tick: int, inbox: Inbox) -> None:
        """Mark what takes effect in a tick."""
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, SourceEventSpec):
                if isinstance(event, SourceMovesSpec):
                    self._places_m[event.source] = event.to_m
                self._sources[event.source].add(tick, self._places_m[event.source], event.text, colors.SOURCE)
            elif event.about_agent is not None:
                agent = self._agents[event.about_agent]
                agent.markers.add(tick, agent.position_m, event.text, agent.names.color)

    def all(self) -> Sequence[MarkerRows]:
        """Return all rows but those of agents."""
        return self._sources


_MARK_RADIUS_M = 0.06


class DoorRows:
    """A box over time: a row with it wherever it is closed, one without wherever it opens."""

    def __init__(self, entity: str, box: Box) -> None:
        self._entity = entity
        self._box = box
        self._ticks: list[int] = []
        self._are_closed: list[bool] = []

    def draw(self, file: RecordingFile) -> None:
        """Draw how it looks while it is closed."""
        file.draw(self._entity, door_look(self._box))

    def add(self, tick: int, *, is_closed: bool) -> None:
        """Take note that it is closed, or open, from a tick on."""
        self._ticks.append(tick)
        self._are_closed.append(is_closed)

    def send(self, file: RecordingFile) -> None:
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


class AllDoorRows:
    """All doors of a run, with a mark in the room for each event that moves one."""

    def __init__(self, scenario: Scenario, environment: Environment) -> None:
        self._scenario = scenario
        self._room = DynamicEnvironment(environment, scenario)
        self._boxes = {box.name: box for box in find_door_boxes(environment)}
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
    def room(self) -> DynamicEnvironment:
        """The room as it is now."""
        return self._room

    def draw(self, file: RecordingFile) -> None:
        """Draw how doors look, and note which are closed at the start."""
        for name, all_rows in self._rows.items():
            for rows in all_rows:
                rows.draw(file)
                rows.add(0, is_closed=name in self._room.variant.closed)

    def add(self, tick: int, inbox: Inbox) -> None:
        """Take note of the doors that move in a tick."""
        if self._room.obey(inbox):
            for name, all_rows in self._rows.items():
                for rows in all_rows:
                    rows.add(tick, is_closed=name in self._room.variant.closed)
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, DoorEventSpec) and event.door in self._boxes:
                box = self._boxes[event.door]
                x_m, y_m = ((box.min_m[axis] + box.max_m[axis]) / 2 for axis in (0, 1))
                self._marks[event.door].add(tick, (x_m, y_m, box.max_m[2]), event.text, colors.READING)

    def all(self) -> Sequence[Rows]:
        """Return all rows."""
        return [*(rows for all_rows in self._rows.values() for rows in all_rows), *self._marks.values()]
