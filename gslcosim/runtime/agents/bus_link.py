"""The link to an agent on the bus. What it says is enqueued at once, in bounded memory, whatever it sends."""

from gslcosim.bus.zenoh_bus import ZenohBus
from gslcosim.contract import codec, keys
from gslcosim.contract.messages import Briefing, Ending, Observation
from gslcosim.runtime.agents.door import MAX_COMMAND_BYTES
from gslcosim.runtime.agents.events import CommandCame, CommandRefused, PutEvent
from gslcosim.runtime.agents.links import Seen

MAX_WAITING_BYTES = 32 * 1024 * 1024
_EVENT_BYTES = 256  # what even an empty message costs while it waits


class BusLink:
    """An agent that is a process on the bus, where it hears its briefing and observations from their writer.

    So only what may have got lost is sent from here. The bus calls `on_command` and `on_longer` on one thread;
    `handled` is called on another. What an agent sends faster than it can be judged is dropped beyond
    `MAX_WAITING_BYTES`, and told once.
    """

    may_lose = True

    def __init__(self, agent: str, bus: ZenohBus, put: PutEvent) -> None:
        self._agent = agent
        self._bus = bus
        self._put = put
        self._briefing: bytes | None = None
        self._question: bytes | None = None
        self._received_bytes = 0
        self._handled_bytes = 0
        self._has_told = False
        # While nobody else writes what the agent is told, because it lies before the tick at which the run goes on.
        self.is_writer = False

    def listen(self) -> None:
        """Hear the agent from now on."""
        key = keys.raw_command(self._agent)
        self._bus.subscribe(key, self.on_command, max_bytes=MAX_COMMAND_BYTES, on_longer=self.on_longer)

    def brief(self, briefing: Briefing, payload: bytes) -> None:
        """Keep the briefing for a repetition; see `AgentLink`."""
        del briefing
        self._briefing = payload
        if self.is_writer:
            self._bus.publish(keys.briefing(self._agent), payload, encoding=codec.encoding_of(Briefing))

    def observe(self, observation: Seen, payload: bytes) -> None:
        """Keep a question for a repetition; see `AgentLink`."""
        if observation.awaiting_command:
            self._question = payload
        if self.is_writer:
            for key in (keys.observation, keys.question) if observation.awaiting_command else (keys.observation,):
                self._bus.publish(key(self._agent), payload, encoding=codec.encoding_of(Observation), urgent=True)

    def repeat(self) -> None:
        """Publish briefing and last question again, which is harmless; see `AgentLink`."""
        if self._briefing is not None:
            self._bus.publish(keys.briefing(self._agent), self._briefing)
        if self._question is not None:
            for key in (keys.observation(self._agent), keys.question(self._agent)):
                self._bus.publish(key, self._question, urgent=True)

    def handled(self, event: CommandCame | CommandRefused) -> None:
        """Take note that a command has been judged; see `AgentLink`."""
        if isinstance(event, CommandCame):
            self._handled_bytes += len(event.payload) + _EVENT_BYTES

    def end(self, ending: Ending, payload: bytes) -> None:
        """Publish the end of the run; see `AgentLink`."""
        self._bus.publish(keys.ending(self._agent), payload, encoding=codec.encoding_of(type(ending)), urgent=True)

    def on_command(self, key: str, payload: bytes) -> None:
        """Take a command from the bus."""
        del key
        if self._received_bytes - self._handled_bytes < MAX_WAITING_BYTES:
            self._received_bytes += len(payload) + _EVENT_BYTES
            self._put(CommandCame(agent=self._agent, payload=payload))
        elif not self._has_told:
            self._has_told = True
            text = "expected one command for each observation that awaits one, was a flood; some of it was dropped."
            self._put(CommandRefused(agent=self._agent, text=text))

    def on_longer(self, key: str, n_bytes: int) -> None:
        """Take note of a command that is too long to be fetched."""
        del key
        text = f"expected at most {MAX_COMMAND_BYTES} bytes, was {n_bytes}."
        self._put(CommandRefused(agent=self._agent, text=text))
