"""One agent's place in a run: what it is told, what it owes and for how long, and which commands of it count."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending
from gslcosim.runtime.agents.door import Door, door_name
from gslcosim.runtime.agents.events import AgentEvent, AgentGone, AgentJoined, AnswerMissed, CommandCame, CommandRefused
from gslcosim.runtime.agents.links import AgentLink, Seen
from gslcosim.runtime.agents.past_door import door_in
from gslcosim.runtime.digest import Trail
from gslcosim.runtime.machine_notes import MachineLog
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.snapshots.told import ToldLog
from gslcosim.runtime.status import ParticipantState, ParticipantStatus
from gslcosim.runtime.stepper import Sent
from gslcosim.scenario.models.scenario import AgentSpec

REPEAT_AFTER_S = 1.0


@dataclass
class Desk:
    """An agent behind its door and its link, whatever kind of link that is.

    Methods return the commands that count now, with their bytes; whoever holds the desk delivers them. `journal` is
    told each of them; `last_words` returns the end of the agent's log; `told` keeps what the agent is told, where the
    run takes snapshots; `machine` notes decisions and faults where the run is recorded. Times are those
    of the monotonic clock [s].
    """

    agent: str
    door: Door
    link: AgentLink
    answer_within_s: float
    journal: Callable[[Command], None] = lambda _: None
    last_words: Callable[[], str] = lambda: ""
    told: ToldLog | None = None
    machine: MachineLog = field(default_factory=MachineLog)
    trail: Trail = field(default_factory=Trail)
    decisions_s: list[float] = field(default_factory=list[float])
    is_ready: bool = False
    last_tick: int = -1
    _n_faults_noted: int = 0
    _asked_at_s: float | None = None
    _repeated_at_s: float = 0.0

    @property
    def owes_answer(self) -> bool:
        """Whether simulated time may have to wait for the agent."""
        return self._asked_at_s is not None

    @property
    def is_awaited(self) -> bool:
        """Whether the run cannot begin yet for want of the agent; one that is known to be gone is not waited for."""
        return not (self.is_ready or self.door.faults)

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Send the agent its briefing."""
        self.link.brief(briefing, payload)

    def observe(self, observation: Seen, payload: bytes) -> list[Sent]:
        """Send the agent an observation."""
        self.last_tick = observation.tick
        if self.told is not None:
            self.told.add(payload)
        commands = self.door.observed(observation)
        if self.door.pending and self._asked_at_s is None:
            self._asked_at_s = self._repeated_at_s = time.monotonic()
        passed = self._pass(commands)
        self.link.observe(observation, payload)
        return passed

    def handle(self, event: AgentEvent) -> list[Sent]:
        """Take what the agent did."""
        match event:
            case AgentJoined():
                self.is_ready = True
                return []
            case CommandCame() | CommandRefused():
                return self._hear(event)
            case AnswerMissed(text=text):
                return self.lose(text) if self.door.pending else []
            case AgentGone(reason=reason):
                return self.lose(reason)

    def lose(self, reason: str) -> list[Sent]:
        """Take note that the agent is gone."""
        words = self.last_words()
        return self._pass(self.door.lost(f"{reason} The end of its log: {words}" if words else reason))

    def check_time(self) -> list[Sent]:
        """Give the agent up where it has owed an answer for too long; repeat a question that may have got lost."""
        if self._asked_at_s is None:
            return []
        now_s = time.monotonic()
        if now_s - self._asked_at_s > self.answer_within_s:
            return self.lose(f"the agent did not answer within {self.answer_within_s:g} s.")
        if self.link.may_lose and now_s - self._repeated_at_s > REPEAT_AFTER_S:
            self._repeated_at_s = now_s
            self.link.repeat()
        return []

    def postpone(self, missed_s: float) -> None:
        """Let the agent have its time again that this process has missed [s]."""
        if self._asked_at_s is not None:
            self._asked_at_s = min(self._asked_at_s + missed_s, time.monotonic())

    def end(self, ending: Ending) -> None:
        """Tell the agent that the run is over."""
        if self.told is not None:
            self.told.flush()
        self.machine.close()
        self.link.end(ending, codec.encode(ending))

    def _hear(self, event: CommandCame | CommandRefused) -> list[Sent]:
        match event:
            case CommandCame(payload=payload, decided_in_s=decided_in_s):
                commands = self.door.received(payload)
            case CommandRefused(text=text):
                commands, decided_in_s = self.door.refused(text), None
        if self._asked_at_s is not None:
            waited_s = time.monotonic() - self._asked_at_s
            self.decisions_s.append(waited_s if decided_in_s is None else decided_in_s)
            # What is flown again was decided before.
            if decided_in_s != 0.0:
                asked_tick = commands[0].tick if commands else self.last_tick
                self.machine.decided(self.agent, asked_tick, self.decisions_s[-1])
        self.link.handled(event)
        return self._pass(commands)

    def _pass(self, commands: Iterable[Command]) -> list[Sent]:
        for fault in self.door.faults[self._n_faults_noted :]:
            self.machine.failed(f"agent {fault.agent}", fault.tick, fault.text)
        self._n_faults_noted = len(self.door.faults)
        passed: list[Sent] = []
        for command in commands:
            sent = Sent(keys.command(self.agent), command, codec.encode(command))
            self.trail.append(command.tick, sent.payload)
            self.journal(command)
            passed.append(sent)
        if passed:
            self._repeated_at_s = time.monotonic()
            self._asked_at_s = self._repeated_at_s if self.door.pending else None
        return passed


def desk_of(agent: AgentSpec, setup: Setup, link: AgentLink) -> Desk:
    """Return the desk of an agent of a run."""
    run_dir = setup.run_dir
    return Desk(
        agent.name,
        door_in(agent, setup.scenario, setup.past),
        link,
        agent.answer_within_s,
        journal=lambda command: run_dir.log_command(agent.name, command),
        last_words=lambda: run_dir.last_words(door_name(agent.process)),
        told=ToldLog(run_dir, agent.name) if setup.scenario.snapshots is not None else None,
        machine=MachineLog(run_dir.path if setup.scenario.recording.enabled else None),
    )


def agent_statuses(desks: Mapping[str, Desk]) -> list[ParticipantStatus]:
    """Return one moment of all agents."""
    return [ParticipantStatus(name=name, state=_state_of(desk), tick=desk.last_tick) for name, desk in desks.items()]


def _state_of(desk: Desk) -> ParticipantState:
    if desk.is_awaited:
        return "joining"
    return "deciding" if desk.owes_answer else "waiting"
