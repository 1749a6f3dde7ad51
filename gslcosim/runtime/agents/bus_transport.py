"""Agents on the bus: their transport, and their sessions as participants."""

from collections.abc import Callable

from typing_extensions import override

from gslcosim.bus.interface import Bus
from gslcosim.bus.zenoh_bus import ZenohBus
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Command, Ending, Observation
from gslcosim.contract.participant import get_agent_participant
from gslcosim.runtime.agents.session import (
    AgentSession,
    AgentTransport,
    CommandReceived,
    CommandRefused,
    EventSink,
    ObservationOrHead,
)
from gslcosim.runtime.agents.validator import MAX_COMMAND_BYTES
from gslcosim.runtime.distributed import protocol
from gslcosim.runtime.distributed.host import PROGRESS_PERIOD_TICKS
from gslcosim.runtime.distributed.retransmission import RETRANSMIT_TICKS, ReorderBuffer, RetransmitBuffer
from gslcosim.runtime.stepper import SentMessage

MAX_QUEUED_BYTES = 32 * 1024 * 1024
_EVENT_BYTES = 256  # cost of an empty message while it waits


class BusTransport(AgentTransport):
    """Transport to an agent that is a process on the bus, which gets briefing and observations from their writer.

    Only messages that may have got lost are sent from here. The bus calls `on_command` and `on_longer` on one thread;
    `acknowledge` is called on another. Beyond `MAX_QUEUED_BYTES`, commands that come faster than they can be judged
    are dropped, which is reported once.
    """

    is_lossy = True

    def __init__(self, agent: str, bus: ZenohBus, put: EventSink) -> None:
        self._agent = agent
        self._bus = bus
        self._put = put
        self._briefing: bytes | None = None
        self._question: bytes | None = None
        self._received_bytes = 0
        self._handled_bytes = 0
        self._has_reported = False
        # True while past observations are sent from here: sensing resumes at the snapshot.
        self.is_writer = False

    def listen(self) -> None:
        """Subscribe to the agent's commands."""
        key = keys.raw_command(self._agent)
        self._bus.subscribe(key, self.on_command, max_bytes=MAX_COMMAND_BYTES, on_longer=self.on_longer)

    @override
    def brief(self, briefing: Briefing, payload: bytes) -> None:
        del briefing
        self._briefing = payload
        if self.is_writer:
            self._bus.publish(keys.briefing(self._agent), payload, encoding=codec.get_encoding(Briefing))

    @override
    def observe(self, observation: ObservationOrHead, payload: bytes) -> None:
        if observation.awaiting_command:
            self._question = payload
        if self.is_writer:
            for key in (keys.observation, keys.question) if observation.awaiting_command else (keys.observation,):
                self._bus.publish(key(self._agent), payload, encoding=codec.get_encoding(Observation), urgent=True)

    @override
    def repeat(self) -> None:
        if self._briefing is not None:
            self._bus.publish(keys.briefing(self._agent), self._briefing)
        if self._question is not None:
            for key in (keys.observation(self._agent), keys.question(self._agent)):
                self._bus.publish(key, self._question, urgent=True)

    @override
    def acknowledge(self, event: CommandReceived | CommandRefused) -> None:
        if isinstance(event, CommandReceived):
            self._handled_bytes += len(event.payload) + _EVENT_BYTES

    @override
    def end(self, ending: Ending, payload: bytes) -> None:
        self._bus.publish(keys.ending(self._agent), payload, encoding=codec.get_encoding(type(ending)), urgent=True)

    def on_command(self, key: str, payload: bytes) -> None:
        """Take a command from the bus."""
        del key
        if self._received_bytes - self._handled_bytes < MAX_QUEUED_BYTES:
            self._received_bytes += len(payload) + _EVENT_BYTES
            self._put(CommandReceived(agent=self._agent, payload=payload))
        elif not self._has_reported:
            self._has_reported = True
            text = "expected one command for each observation that awaits one, was a flood; some of it was dropped."
            self._put(CommandRefused(agent=self._agent, text=text))

    def on_longer(self, key: str, n_bytes: int) -> None:
        """Take note of a command that is too long to be fetched."""
        del key
        text = f"expected at most {MAX_COMMAND_BYTES} bytes, was {n_bytes}."
        self._put(CommandRefused(agent=self._agent, text=text))


class AgentHost:
    """Session of one agent as a participant on the bus: observations in, commands out, losses repaired.

    Args:
        on_resent: Receives, on any thread, an observation that was asked for again.
        more_ticks: Further ticks for which commands are kept for readers that missed them.
    """

    def __init__(
        self, session: AgentSession, bus: Bus, on_resent: Callable[[bytes], None], more_ticks: int = 0
    ) -> None:
        self.session = session
        self._name = get_agent_participant(session.agent)
        self._bus = bus
        self._on_resent = on_resent
        self._in_order: ReorderBuffer[tuple[codec.ObservationHead, bytes]] = ReorderBuffer()
        self._kept = RetransmitBuffer(RETRANSMIT_TICKS + more_ticks)
        self._reported_tick = -1
        session.deliver = self._publish

    def listen(self) -> None:
        """Answer readers that missed a command."""
        self._bus.answer(protocol.build_resend_key(self._name), self._kept.answer)
        self._bus.answer(
            protocol.build_finished_key(self._name),
            lambda _: [protocol.ReaderReport(name=self._name, tick=self.session.last_tick).to_bytes()],
        )

    def brief(self, payload: bytes) -> None:
        """Take the agent's briefing."""
        self.session.brief(codec.decode_trusted(Briefing, payload), payload)

    def observe(self, payload: bytes) -> None:
        """Take an observation, in any order; ask for one that seems to be lost."""
        head = codec.decode_observation_head(payload)
        # The agent gets the bytes as they are, so only the head is decoded.
        for next_head, message in self._in_order.take(head.tick, (head, payload)):
            self.session.observe(next_head, message)
            if next_head.tick - self._reported_tick >= PROGRESS_PERIOD_TICKS:
                self._reported_tick = next_head.tick
                report = protocol.TickReport(tick=next_head.tick)
                self._bus.publish(protocol.build_progress_key(self._name), report.to_bytes())
        if (tick := self._in_order.lost()) is not None:
            question = protocol.ResendRequest(port=keys.observation(self.session.agent), tick=tick).to_bytes()
            self._bus.ask(protocol.build_resend_key("sensing"), question, lambda _, resent: self._on_resent(resent))

    def _publish(self, sent: SentMessage) -> None:
        self._kept.keep(sent)
        self._bus.publish(sent.port, sent.payload, encoding=codec.get_encoding(Command), urgent=True)
