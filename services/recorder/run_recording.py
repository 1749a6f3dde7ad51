"""Recording of one run: takes note of its messages tick by tick and sends rows to a Rerun file."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import rerun as rr

from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    BodyState,
    Command,
    FieldSamples,
    FilamentCloud,
    Observation,
    RadioTraffic,
    RadioTransmission,
    Score,
    Verdict,
)
from gslcosim.contract.participant import Inbox
from gslcosim.environment.model import Environment
from gslcosim.runtime.run_dir import read_machine_notes
from gslcosim.scenario import Scenario
from gslcosim_services.recorder import stream_table as streams
from gslcosim_services.recorder.agent_look import draw_agent, draw_belief_curves
from gslcosim_services.recorder.blueprint import default_blueprint, legend_text, summary_text
from gslcosim_services.recorder.colors import GasScale
from gslcosim_services.recorder.entities import build_entities, list_gas_names
from gslcosim_services.recorder.recording_file import RecordingFile
from gslcosim_services.recorder.rows.agents import AgentRows
from gslcosim_services.recorder.rows.columns import RecordingRows, split_columns
from gslcosim_services.recorder.rows.events import (
    ContactRows,
    DoorRows,
    EventMarkRows,
    ServiceRows,
    WindLayer,
    WindRows,
)
from gslcosim_services.recorder.rows.gas import GasRows
from gslcosim_services.recorder.scene import draw_map, draw_room, draw_sources

# Referee's events that have a mark at their place in the room, with its text; all of them are in the log.
FIRST_GAS = "first gas"
MARKED_EVENTS = {"take_off": "start", "gas_contact": FIRST_GAS}
WARNING_EVENTS = frozenset({"contact", "refused", "collision", "agent_failed", "out_of_bounds"})
# Ticks are taken apart together, column by column: that costs half of a call for each number. More of them would only
# keep large messages longer.
BATCH_TICKS = 64


class RunRecording:
    """Recording of one run: static things are drawn at once, moving ones noted tick by tick and written with `send`.

    `is_over` is true once the verdict has come; later messages are not recorded.
    """

    def __init__(
        self, file: RecordingFile, scenario: Scenario, environment: Environment, wind_layer: WindLayer, folder: Path
    ) -> None:
        """Draw the static scene.

        Args:
            file: An empty file; it belongs to this object from now on.
            wind_layer: The environment's wind at the slice's height.
            folder: Folder of the machine's notes of the run, if there are any.
        """
        self._file = file
        self._scenario = scenario
        self._environment = environment
        self._folder = folder
        self.is_over = False
        self._waiting: list[tuple[int, Inbox]] = []
        self._rows = RecordingRows(file)
        self._events = self._rows.of(streams.EVENTS)
        self._radio = self._rows.of(streams.RADIO)
        self._faults = self._rows.of(streams.FAULTS)
        self._gas = GasRows(self._rows, scenario)
        self._services = ServiceRows(self._rows, scenario)
        gases = list_gas_names(scenario)
        agents = [AgentRows(self._rows, names, gases, scenario.tick_ns) for names in build_entities(scenario)]
        self._agents = {agent.names.agent.name: agent for agent in agents}
        self._event_marks = EventMarkRows(self._rows, scenario, self._agents)
        contacts, tick_ns = self._rows.of(streams.CONTACTS), scenario.tick_ns
        floors = [box.name for box in environment.boxes if box.kind == "floor"]
        self._contacts = {
            name: ContactRows(agent, contacts, tick_ns=tick_ns, floors=floors) for name, agent in self._agents.items()
        }
        self._sandboxes: Mapping[str, str] = {}
        self._observations = [(agent, keys.observation(name)) for name, agent in self._agents.items()]
        self._commands = [(agent, keys.command(name)) for name, agent in self._agents.items()]
        self._in_space = [(agent, port) for agent, port in self._observations if agent.shows_space]
        self._bodies: tuple[BodyState, ...] = ()
        self._touching: set[str] = set()

        draw_room(file, environment)
        draw_sources(file, scenario)
        draw_map(file, environment, GasScale.of(scenario), scenario.slice_height_m)
        self._doors = DoorRows(self._rows, scenario, environment)
        later = {
            variant: WindLayer(room, scenario.slice_height_m, like=wind_layer)
            for variant, room in environment.later_rooms.items()
        }
        self._wind = WindRows(self._rows, wind_layer, later)
        # Without events and with one wind, nothing of the room ever changes.
        self._is_still = wind_layer.is_steady and not scenario.events
        for agent in agents:
            draw_agent(file, agent.names, gases, label=self._label(agent))
        file.draw(streams.LEGEND.entity, rr.TextDocument(legend_text(scenario), media_type=rr.MediaType.MARKDOWN))
        self._write_summary(tick=0, verdict=None)
        # Rows overtake what stands still, which waits some time in Rerun: a file cut off early would lack the room.
        file.flush()

    def note(self, tick: int, inbox: Inbox) -> None:
        """Record all messages of a tick but the verdict."""
        self._file.check()
        self._waiting.append((tick, inbox))
        if len(self._waiting) >= BATCH_TICKS:
            self._take()

    def _take(self) -> None:
        waiting, self._waiting = self._waiting, []
        for tick, inbox in waiting:
            self._note_rare(tick, inbox)
        self._note_columns(waiting)

    # Rare messages, and those whose rows depend on earlier ones: tick by tick.
    def _note_rare(self, tick: int, inbox: Inbox) -> None:
        if not self._is_still:
            self._doors.add(tick, inbox)
            time_s = self._scenario.gas.warm_up_s + seconds_from_ticks(tick, self._scenario.tick_ns)
            self._wind.add(tick, time_s, self._doors.room.variant)
        bodies = cast(BodyPoses | None, inbox.get(keys.BODIES))
        if bodies is not None:
            self._bodies = bodies.bodies
            for body in bodies.bodies:
                if body.contacts or body.agent in self._touching:
                    self._contacts[body.agent].add(tick, body)
                    (self._touching.add if body.contacts else self._touching.discard)(body.agent)
        cloud = cast(FilamentCloud | None, inbox.get(keys.FILAMENTS))
        if cloud is not None:
            self._gas.add(tick, cloud)
        if self._scenario.events:
            self._locate_agents()
            self._event_marks.add(tick, inbox)
        self._note_space(tick, inbox)
        self._note_commands(tick, inbox)
        traffic = cast(RadioTraffic | None, inbox.get(keys.RADIO))
        for sent in traffic.transmissions if traffic else ():
            self._radio.add(tick, (format_transmission(sent), "WARN" if sent.refusal else "INFO"))
        self._services.add(tick, inbox)
        self._note_events(tick, cast(Score | None, inbox.get(keys.SCORE)))

    # Messages of every tick: column by column, which costs a fraction of a call for each number.
    def _note_columns(self, waiting: Sequence[tuple[int, Inbox]]) -> None:
        ticks, bodies = _list_messages(waiting, keys.BODIES)
        for agent, column in split_columns(ticks, [message.bodies for message in bodies], "agent"):
            self._agents[agent].note_bodies(*column)
        ticks, samples = _list_messages(waiting, keys.SAMPLES)
        for (agent, sensor), column in split_columns(ticks, [each.samples for each in samples], "agent", "sensor"):
            self._agents[agent].note_samples(sensor, *column)
        for agent, port in self._observations:
            ticks, observations = _list_messages(waiting, port)
            for sensor, column in split_columns(ticks, [message.readings for message in observations], "sensor"):
                agent.note_readings(sensor, *column)
        ticks, scores = _list_messages(waiting, keys.SCORE)
        for agent, column in split_columns(ticks, [message.agents for message in scores], "agent"):
            self._agents[agent].note_scores(*column)

    def end(self, verdict: Verdict) -> None:
        """Send the waiting rows and write the end of the run."""
        self.is_over = True
        self._take()
        time_s = seconds_from_ticks(verdict.tick, self._scenario.tick_ns)
        text = f"the run ends after {time_s:g} s: {verdict.end_reason.replace('_', ' ')}"
        self._events.add(verdict.tick, (text, "INFO"))
        self._note_machine(verdict.tick)
        self._send_with_last_strips()
        self._write_summary(tick=verdict.tick, verdict=verdict)
        self._file.flush()

    def send(self) -> None:
        """Send the rows that wait."""
        self._take()
        self._rows.send()

    def close(self) -> None:
        """Send the waiting rows, write the file's footer and release it."""
        try:
            if not self.is_over:
                self._note_machine(sys.maxsize)
            self._send_with_last_strips()
        finally:
            self._file.close()

    def _note_machine(self, last_tick: int) -> None:
        notes = read_machine_notes(self._folder)
        self._sandboxes = notes.sandboxes
        for name, agent in self._agents.items():
            for tick, taken_ms in notes.decisions_ms.get(name, ()):
                if tick <= last_tick:
                    agent.of(streams.DECISION_TIME).add(tick, taken_ms)
        for tick, participant, text in notes.faults:
            if tick <= last_tick:
                self._faults.add(tick, (f"{participant}: {text}", "WARN"))

    def _send_with_last_strips(self) -> None:
        self._take()
        for agent in self._agents.values():
            agent.track.end_strip()
        self.send()

    def _note_space(self, tick: int, inbox: Inbox) -> None:
        if not self._in_space:
            return
        bodies = cast(BodyPoses | None, inbox.get(keys.BODIES))
        by_agent = {body.agent: body for body in bodies.bodies} if bodies else {}
        samples = cast(FieldSamples | None, inbox.get(keys.SAMPLES))
        for agent, port in self._in_space:
            observation = cast(Observation | None, inbox.get(port))
            body = by_agent.get(agent.names.agent.name)
            agent.note_space(tick, body, samples.samples if samples else (), observation)

    def _note_commands(self, tick: int, inbox: Inbox) -> None:
        for agent, port in self._commands:
            command = cast(Command | None, inbox.get(port))
            if command is not None:
                before = (agent.has_beliefs, agent.has_notes)
                agent.note_command(tick, command)
                if agent.has_beliefs and not before[0]:
                    draw_belief_curves(self._file, agent.names, label=self._label(agent))
                if (agent.has_beliefs, agent.has_notes) != before:
                    self._lay_out()

    # Names of curves begin with the agent where there are several.
    def _label(self, agent: AgentRows) -> str:
        return "" if len(self._agents) == 1 else f"{agent.names.agent.name} "

    # Called for marks at a vehicle alone, which are rare.
    def _locate_agents(self) -> None:
        for body in self._bodies:
            self._agents[body.agent].position_m = body.position_world_m

    # Which agents publish beliefs or notes is not known before the run, and an empty view would take others' place.
    def _lay_out(self) -> None:
        believers = tuple(name for name, rows in self._agents.items() if rows.has_beliefs)
        has_notes = any(rows.has_notes for rows in self._agents.values())
        self._file.lay_out(
            default_blueprint(self._scenario, self._environment, believers=believers, has_notes=has_notes)
        )

    def _note_events(self, tick: int, score: Score | None) -> None:
        if score is None or not score.events:
            return
        self._locate_agents()
        for event in score.events:
            level = "WARN" if event.kind in WARNING_EVENTS else "INFO"
            agent = self._agents.get(event.agent) if event.agent is not None else None
            self._events.add(tick, (f"{event.agent}: {event.text}" if agent else event.text, level))
            label = MARKED_EVENTS.get(event.kind)
            if agent is not None and label is not None:
                # Those of several vehicles would cover each other.
                is_shown = len(self._agents) == 1
                agent.mark(tick, agent.position_m, label, is_shown=is_shown)

    def _write_summary(self, *, tick: int, verdict: Verdict | None) -> None:
        text = summary_text(self._scenario, self._environment, verdict, self._sandboxes)
        columns = rr.TextDocument.columns(text=[text], media_type=[rr.components.MediaType.MARKDOWN])
        self._file.send(streams.SUMMARY.entity, [tick], columns)


def _list_messages(waiting: Sequence[tuple[int, Inbox]], port: str) -> tuple[list[int], list[Any]]:
    found = [(tick, message) for tick, inbox in waiting if (message := inbox.get(port)) is not None]
    return [tick for tick, _ in found], [message for _, message in found]


def format_transmission(sent: RadioTransmission) -> str:
    """Return a text and its fate in one line."""
    head = f"{sent.sender} on {sent.message.channel} to {sent.message.to}: {sent.message.text}"
    if sent.refusal is not None:
        return f"{head}   [refused: {sent.refusal}]"
    fates = {"heard by": sent.reached, "lost for": sent.lost, "out of range of": sent.out_of_range}
    fates_text = "; ".join(f"{words} {', '.join(names)}" for words, names in fates.items() if names)
    return f"{head}   [{fates_text}]"
