"""The recorder as a participant: reads everything, writes one Rerun file."""

from pathlib import Path
from typing import cast

import rerun as rr

from gslcosim.contract import keys
from gslcosim.contract.messages import (
    BodyPoses,
    Command,
    FieldSamples,
    FilamentCloud,
    Observation,
    RadioTraffic,
    RadioTransmission,
    Score,
    Verdict,
)
from gslcosim.contract.participant import Episode, Inbox, Outbox, ParticipantSpec
from gslcosim.environment.model import Environment
from gslcosim.recording import entities
from gslcosim.recording.colors import GasScale
from gslcosim.recording.entities import entities_of, gases_in
from gslcosim.recording.layout.blueprint import default_blueprint
from gslcosim.recording.ports import recorder_spec
from gslcosim.recording.rows.agents import AgentRows
from gslcosim.recording.rows.columns import FilamentRows, Rows, SliceRows, TextRows
from gslcosim.recording.rows.contacts import ContactNotes
from gslcosim.recording.rows.service_curves import ServiceRows
from gslcosim.recording.rows.wind_layer import WindLayer, WindRows
from gslcosim.recording.run_file import RunFile
from gslcosim.recording.scene import draw_map, draw_room, draw_sources
from gslcosim.recording.summary import summary_text, title
from gslcosim.scenario import Scenario
from gslcosim.ticks import seconds_from_ticks

# Rows are sent together: a call costs some 100 us, whether it carries one row or many.
FLUSH_TICKS = 128
# What of the referee's events is marked in the room where it happened; all of them are in its log.
MARKED_EVENTS = {"take_off": "start", "gas_contact": "first gas"}
WARNING_EVENTS = frozenset({"contact", "refused", "collision", "agent_failed", "out_of_bounds"})


class RecorderCore:
    """Writes a run into one .rrd file that opens with a layout of its own.

    Reads every port of the run with delay 0, writes none. Draws nothing random and reads no clock, so equal runs give
    equal content. What comes after the verdict is not recorded. The file exists from `reset` on and is whole when
    `close` has returned. Steps only append; every `FLUSH_TICKS` ticks the rows are sent to the file.

    Raises RecordingError when the file cannot be written; the runtime then stops the run.
    """

    def __init__(self, scenario: Scenario, environment: Environment, path: Path, *, run_id: str | None = None) -> None:
        """Prepare a recording.

        Args:
            scenario: What is flown.
            environment: Where.
            path: The file to write; an existing one is replaced at `reset`.
            run_id: The recording's identity in the viewer; by default the name of the file's folder.
        """
        self._scenario = scenario
        self._environment = environment
        self._path = path
        self._run_id = run_id or path.resolve().parent.name
        self._spec = recorder_spec(scenario)
        self._wind_layer = WindLayer(environment, scenario.slice_height_m)
        self._file: RunFile | None = None
        self._begin()

    @property
    def spec(self) -> ParticipantSpec:
        """Return the declared reads and writes."""
        return self._spec

    def reset(self, episode: Episode) -> Outbox:
        """Open the file and draw what stands still."""
        del episode
        self.close()
        self._begin()
        self._file = RunFile(
            self._path,
            run_id=self._run_id,
            name=title(self._scenario),
            tick_ns=self._scenario.tick_ns,
            blueprint=default_blueprint(self._scenario, self._environment),
        )
        self._draw_scene(self._file)
        # Rows overtake what stands still, which waits some time in Rerun: a file cut off early would lack the room.
        self._file.flush()
        return {}

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Take note of everything of this tick."""
        if self._is_over:
            return {}
        self._wind.add(tick, self._scenario.gas.warm_up_s + seconds_from_ticks(tick, self._scenario.tick_ns))
        self._note_truth(tick, inbox)
        self._note_agents(tick, inbox)
        self._note_radio(tick, cast(RadioTraffic | None, inbox.get(keys.RADIO)))
        self._services.add(tick, inbox)
        self._note_score(tick, cast(Score | None, inbox.get(keys.SCORE)))
        verdict = cast(Verdict | None, inbox.get(keys.VERDICT))
        if verdict is not None:
            self._end(verdict)
        elif tick % FLUSH_TICKS == FLUSH_TICKS - 1:
            self._send_all()
        return {}

    def close(self) -> None:
        """Send what waits, write the file's footer and release it; without an open file, do nothing."""
        if self._file is None:
            return
        file = self._file
        for agent in self._agents.values():
            agent.track.end_strip()
        self._send_all()
        self._file = None
        file.close()

    def _begin(self) -> None:
        self._is_over = False
        gases, tick_ns = gases_in(self._scenario), self._scenario.tick_ns
        self._agents = {names.agent.name: AgentRows(names, gases, tick_ns) for names in entities_of(self._scenario)}
        self._filaments = FilamentRows(entities.FILAMENTS, self._scenario)
        self._slices: dict[str, SliceRows] = {}
        self._wind = WindRows(entities.WIND, self._wind_layer)
        self._events = TextRows(entities.EVENTS)
        self._contact_log = TextRows(entities.CONTACTS)
        self._contacts = {name: self._contact_notes(name, agent) for name, agent in self._agents.items()}
        self._radio = TextRows(entities.RADIO)
        self._services = ServiceRows(self._scenario)
        self._observations = [(agent, keys.observation(name)) for name, agent in self._agents.items()]
        self._commands = [(agent, keys.command(name)) for name, agent in self._agents.items()]

    def _draw_scene(self, file: RunFile) -> None:
        scenario, environment = self._scenario, self._environment
        draw_room(file, environment)
        draw_sources(file, scenario)
        draw_map(file, environment, GasScale.of(scenario), scenario.slice_height_m)
        self._wind_layer.draw(file, entities.WIND)
        for name, agent in self._agents.items():
            agent.draw(file, label="" if len(self._agents) == 1 else f"{name} ")
        self._write_summary(file, tick=0, verdict=None)

    def _note_truth(self, tick: int, inbox: Inbox) -> None:
        bodies = cast(BodyPoses | None, inbox.get(keys.BODIES))
        for body in bodies.bodies if bodies else ():
            self._agents[body.agent].note_body(tick, body)
            self._contacts[body.agent].add(tick, body)
        samples = cast(FieldSamples | None, inbox.get(keys.SAMPLES))
        for sample in samples.samples if samples else ():
            self._agents[sample.agent].note_sample(tick, sample)
        cloud = cast(FilamentCloud | None, inbox.get(keys.FILAMENTS))
        if cloud is not None:
            self._filaments.add(tick, cloud)
            for item in cloud.slices:
                self._slice_rows(item.gas).add(tick, item)

    def _note_agents(self, tick: int, inbox: Inbox) -> None:
        for agent, port in self._observations:
            observation = cast(Observation | None, inbox.get(port))
            if observation is not None:
                agent.note_observation(tick, observation)
        for agent, port in self._commands:
            command = cast(Command | None, inbox.get(port))
            if command is not None:
                believed_before = agent.belief.has_any
                agent.note_command(tick, command)
                if agent.belief.has_any and not believed_before:
                    self._show_beliefs(agent)

    # Nobody knows before the run who will publish beliefs, and an empty view would be in the way of the others.
    def _show_beliefs(self, agent: AgentRows) -> None:
        if self._file is None:
            return
        believers = tuple(name for name, rows in self._agents.items() if rows.belief.has_any)
        agent.belief.draw(self._file, label="" if len(self._agents) == 1 else f"{agent.names.agent.name} ")
        self._file.lay_out(default_blueprint(self._scenario, self._environment, believers=believers))

    def _note_radio(self, tick: int, traffic: RadioTraffic | None) -> None:
        for sent in traffic.transmissions if traffic else ():
            self._radio.add(tick, radio_text(sent), "WARN" if sent.refusal else "INFO")

    def _note_score(self, tick: int, score: Score | None) -> None:
        if score is None:
            return
        for standing in score.agents:
            self._agents[standing.agent].distance.add(tick, standing.distance_to_source_m)
            self._agents[standing.agent].belief.note_score(tick, standing.belief)
        for event in score.events:
            level = "WARN" if event.kind in WARNING_EVENTS else "INFO"
            agent = self._agents.get(event.agent) if event.agent is not None else None
            self._events.add(tick, f"{event.agent}: {event.text}" if agent else event.text, level)
            label = MARKED_EVENTS.get(event.kind)
            if agent is not None and label is not None:
                agent.markers.add(tick, agent.position_m, label, agent.names.color)

    def _contact_notes(self, name: str, agent: AgentRows) -> ContactNotes:
        floors = [box.name for box in self._environment.boxes if box.kind == "floor"]
        return ContactNotes(name, agent.markers, self._contact_log, tick_ns=self._scenario.tick_ns, floors=floors)

    def _slice_rows(self, gas: str) -> SliceRows:
        if gas not in self._slices:
            self._slices[gas] = SliceRows(f"{entities.SLICES}/{gas}", GasScale.of(self._scenario))
        return self._slices[gas]

    def _end(self, verdict: Verdict) -> None:
        self._is_over = True
        time_s = seconds_from_ticks(verdict.tick, self._scenario.tick_ns)
        self._events.add(
            verdict.tick, f"the run ends after {time_s:g} s: {verdict.end_reason.replace('_', ' ')}", "INFO"
        )
        for agent in self._agents.values():
            agent.track.end_strip()
        self._send_all()
        if self._file is not None:
            self._write_summary(self._file, tick=verdict.tick, verdict=verdict)
            self._file.flush()

    def _write_summary(self, file: RunFile, *, tick: int, verdict: Verdict | None) -> None:
        text = summary_text(self._scenario, self._environment, verdict)
        columns = rr.TextDocument.columns(text=[text], media_type=[rr.components.MediaType.MARKDOWN])
        file.send(entities.SUMMARY, [tick], columns)

    def _send_all(self) -> None:
        if self._file is None:
            return
        logs = (self._events, self._contact_log, self._radio)
        rows: list[Rows] = [self._filaments, self._wind, *logs, *self._slices.values()]
        rows += self._services.all()
        for agent in self._agents.values():
            rows += agent.all()
        for item in rows:
            item.send(self._file)


def radio_text(sent: RadioTransmission) -> str:
    """Return in one line what was sent and what became of it."""
    head = f"{sent.sender} on {sent.message.channel} to {sent.message.to}: {sent.message.text}"
    if sent.refusal is not None:
        return f"{head}   [refused: {sent.refusal}]"
    fates = {"heard by": sent.reached, "lost for": sent.lost, "out of range of": sent.out_of_range}
    told = "; ".join(f"{words} {', '.join(names)}" for words, names in fates.items() if names)
    return f"{head}   [{told}]"
