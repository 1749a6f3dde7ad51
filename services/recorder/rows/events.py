"""Rows of events, wind, probes, and services of other packages, in space and as curves."""

from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract.environment_messages import WIND, ProbeSample, ProbeSamples
from gslcosim.contract.messages import BodyState
from gslcosim.contract.participant import Inbox
from gslcosim.contract.participant_messages import ParticipantValues
from gslcosim.contract.record import Message
from gslcosim.environment.model import Environment, EnvironmentVariant
from gslcosim.environment.plan_view import PlanView, arrow_vectors, is_cut, scale_of_arrows, space_arrows
from gslcosim.environment.variants import DynamicEnvironment, find_door_boxes
from gslcosim.scenario import Scenario
from gslcosim.scenario.models.events import DoorEventSpec, SourceEventSpec, SourceMovesSpec
from gslcosim.scenario.models.scenario import find_due_events
from gslcosim_services.recorder import colors
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.agents import AgentRows
from gslcosim_services.recorder.rows.archetypes import Marker, boxes, markers
from gslcosim_services.recorder.rows.columns import RecordingRows, Rows
from gslcosim_services.recorder.scene import door_look, flat_box
from gslcosim_services.recorder.stream_table import DOORS, MARKS, SERVICES, SOURCE_MARKS, WIND_ARROWS

ARROWS_PER_SIDE = 15
ARROW_RADIUS_SPACINGS = 0.04
DOOR_MARK_RADIUS_M = 0.06


class ServiceRows:
    """Curves of a run's services, `plots/services/<port>/<field>`, one for each field that comes."""

    def __init__(self, rows: RecordingRows, scenario: Scenario) -> None:
        wind = (WIND,) if scenario.has_driven_wind else ()
        self._ports = (*wind, *scenario.curve_ports)
        self._rows = rows

    def add(self, tick: int, inbox: Inbox) -> None:
        """Append the numbers of a tick's messages."""
        for port in self._ports:
            message = inbox.get(port)
            for name, value in _numeric_fields(message) if message is not None else ():
                if name != "tick" and isinstance(value, bool | int | float):
                    self._rows.of(SERVICES, port=port, field=name).add(tick, float(value))


def _numeric_fields(message: Message) -> Iterable[tuple[str, object]]:
    if isinstance(message, ProbeSamples):
        return [curve for sample in message.samples for curve in _curves_of(sample)]
    return (message.values if isinstance(message, ParticipantValues) else message.model_dump()).items()


def _curves_of(sample: ProbeSample) -> list[tuple[str, float]]:
    gases = [(f"{sample.probe}/{each.gas}_ppm", each.mixing_ratio_ppm) for each in sample.gases]
    wind = [(f"{sample.probe}/wind_{axis}_m_s", x) for axis, x in zip("xyz", sample.wind_world_m_s, strict=True)]
    return gases + wind


class WindLayer:
    """The arrows of one layer of an environment's wind.

    Lengths are in proportion to the speed, and the same for all frames; see `gslcosim.environment.plan_view`.
    """

    def __init__(self, environment: Environment, height_m: float, *, like: "WindLayer | None" = None) -> None:
        """Choose the arrows of a layer.

        Args:
            height_m: Height of the layer [m].
            like: Layer that sets the scale of the arrows; absent: a scale of their own.
        """
        plan = PlanView.of(environment, height_m)
        cells, spacing = space_arrows(~plan.solid, ARROWS_PER_SIDE)
        self.wind = environment.wind
        self.spacing_m = spacing * plan.grid.cell_m
        # In the middle of the square that the arrow stands for, so that those at the walls do not point through them.
        middles = np.column_stack([cells + spacing / 2 - spacing // 2, np.full(len(cells), plan.layer + 0.5)])
        self._centres_m = np.array(plan.grid.origin_m) + middles * plan.grid.cell_m
        # (t, n, 3), copied: it is small, and the frames may be a mapped file.
        winds_m_s = np.asarray(self.wind.velocity_m_s[:, cells[:, 0], cells[:, 1], plan.layer], dtype=np.float64)
        own_m_per_m_s = scale_of_arrows(np.linalg.norm(winds_m_s, axis=-1), self.spacing_m)
        self.m_per_m_s = own_m_per_m_s if like is None or not like.m_per_m_s else like.m_per_m_s
        self._vectors_m = arrow_vectors(winds_m_s, self.spacing_m, self.m_per_m_s)

    @property
    def is_steady(self) -> bool:
        """True where the wind has one frame."""
        return self.wind.velocity_m_s.shape[0] == 1

    def arrows_m(self, frame: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the (n, 3) origins and vectors of a frame's arrows, centred on their cells, world frame [m]."""
        vectors_m = self._vectors_m[frame]
        return (self._centres_m - vectors_m / 2).astype(np.float32), vectors_m.astype(np.float32)

    def draw(self, file: RecordingFile, entity: str, *, is_one_of_many: bool = False) -> None:
        """Draw the look of all frames; steady wind as a whole, where it is the only one."""
        is_steady = self.is_steady and not is_one_of_many
        origins_m, vectors_m = self.arrows_m(0) if is_steady else (None, None)
        radius_m = ARROW_RADIUS_SPACINGS * self.spacing_m
        arrows = rr.Arrows3D.from_fields(origins=origins_m, vectors=vectors_m, colors=[colors.WIND], radii=[radius_m])
        file.draw(entity, arrows)


class WindRows:
    """The arrows over time: a row wherever the frame of the wind or the room changes; none where all is steady.

    Args:
        layer: Those at the start.
        later: Those of later rooms, by situation.
    """

    def __init__(self, rows: RecordingRows, layer: WindLayer, later: Mapping[EnvironmentVariant, WindLayer]) -> None:
        self._rows = rows.of(WIND_ARROWS)
        self._layer = layer
        self._later = later
        self._last: tuple[WindLayer, int] | None = None
        layer.draw(rows.file, WIND_ARROWS.entity, is_one_of_many=bool(later))

    def add(self, tick: int, time_s: float, variant: EnvironmentVariant) -> None:
        """Append the arrows of the wind's time [s] and the situation at the end of a tick, if they are new."""
        if self._layer.is_steady and not self._later:
            return
        layer = self._later.get(variant, self._layer)
        shown = (layer, layer.wind.frame_at(time_s))
        if shown != self._last:
            self._last = shown
            self._rows.add(tick, layer.arrows_m(shown[1]))


class ContactRows:
    """Contacts of one vehicle: lines of a log with their duration, and points where they began.

    The log has every one. Points mark the vehicle's position at contacts with anything but a floor, the first one of
    each thing with its name.
    """

    def __init__(self, agent: AgentRows, log: Rows, *, tick_ns: int, floors: Iterable[str]) -> None:
        self._agent = agent.names.agent.name
        self._marks = agent.of(MARKS)
        self._log = log
        self._tick_ns = tick_ns
        self._floors = frozenset(floors)
        self._since: dict[str, int] = {}
        self._named: set[str] = set()

    def add(self, tick: int, body: BodyState) -> None:
        """Append the contacts that begin or end in a tick."""
        if not body.contacts and not self._since:
            return
        for thing in body.contacts:
            if thing not in self._since:
                self._begin(tick, body, thing)
        for thing in [thing for thing in self._since if thing not in body.contacts]:
            lasted_s = seconds_from_ticks(tick - self._since.pop(thing), self._tick_ns)
            self._log.add(tick, (f"{self._agent} is off {thing} after {lasted_s:g} s", "INFO"))

    def _begin(self, tick: int, body: BodyState, thing: str) -> None:
        self._since[thing] = tick
        is_floor = thing in self._floors
        self._log.add(tick, (f"{self._agent} touches {thing}", "INFO" if is_floor else "WARN"))
        if not is_floor:
            label = "" if thing in self._named else f"touches {thing}"
            self._named.add(thing)
            self._marks.add(tick, Marker(body.position_world_m, label, colors.CONTACT))


class EventMarkRows:
    """Points with the texts of events at their places; events without a place in the room have none."""

    def __init__(self, rows: RecordingRows, scenario: Scenario, agents: Mapping[str, AgentRows]) -> None:
        self._rows = rows
        self._scenario = scenario
        self._agents = agents
        self._places_m = [source.position_m for source in scenario.gas.sources]

    def add(self, tick: int, inbox: Inbox) -> None:
        """Mark the events that take effect in a tick."""
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, SourceEventSpec):
                if isinstance(event, SourceMovesSpec):
                    self._places_m[event.source] = event.to_m
                marker = Marker(self._places_m[event.source], event.text, colors.SOURCE)
                self._rows.of(SOURCE_MARKS, source=str(event.source)).add(tick, marker)
            elif event.about_agent is not None:
                agent = self._agents[event.about_agent]
                agent.mark(tick, agent.position_m, event.text)


class DoorRows:
    """All doors of a run as boxes in the room and on the map, with a mark for each event that moves one.

    A door has a row with its box when it closes, and one without when it opens. `room` is the room as it is now.
    """

    def __init__(self, rows: RecordingRows, scenario: Scenario, environment: Environment) -> None:
        """Draw the look of the doors, and those that are closed at the start."""
        self._rows = rows
        self._scenario = scenario
        self.room = DynamicEnvironment(environment, scenario)
        self._boxes = {box.name: box for box in find_door_boxes(environment)}
        height_m = scenario.slice_height_m
        shown = [(DOORS.at(door=name), box) for name, box in self._boxes.items()]
        cut = [box for box in self._boxes.values() if is_cut(box, height_m)]
        shown += [(f"map/doors/{box.name}", flat_box(environment, box, height_m)) for box in cut]
        self._shown = [(box, rows.at(entity, boxes)) for entity, box in shown]
        for box, drawn in self._shown:
            rows.file.draw(drawn.entity, door_look(box))
        self._add_boxes(0)

    def add(self, tick: int, inbox: Inbox) -> None:
        """Append the doors if one moves in a tick, and mark the events."""
        if self.room.obey(inbox):
            self._add_boxes(tick)
        for _, event in find_due_events(self._scenario, inbox):
            if isinstance(event, DoorEventSpec) and event.door in self._boxes:
                box = self._boxes[event.door]
                x_m, y_m = ((box.min_m[axis] + box.max_m[axis]) / 2 for axis in (0, 1))
                marks = self._rows.at(
                    f"{DOORS.at(door=event.door)}/events", partial(markers, radius_m=DOOR_MARK_RADIUS_M)
                )
                marks.add(tick, Marker((x_m, y_m, box.max_m[2]), event.text, colors.READING))

    def _add_boxes(self, tick: int) -> None:
        for box, rows in self._shown:
            rows.add(tick, box if box.name in self.room.variant.closed else None)
