"""One session of a check with a participant: what is played, and what comes back."""

import queue
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from gslcosim.command_lines import exit_text
from gslcosim.conformance.findings import Failure
from gslcosim.conformance.flight import FlightLimits
from gslcosim.conformance.participants.answering import Answering, failure_of_hello, failure_of_outputs
from gslcosim.conformance.participants.scripted_inputs import (
    EMPTY_TICKS,
    TICKS,
    ScriptedInputs,
    briefing_of_check,
    payload_of,
    with_later_fields,
)
from gslcosim.conformance.wires import StartedProcess
from gslcosim.conformance.wiring import AgentExited, Wiring
from gslcosim.contract import codec
from gslcosim.contract.knowledge import ParameterValue
from gslcosim.contract.messages import Ending, Message
from gslcosim.contract.participation import ParticipantHello, ParticipantInputs, ParticipantOutputs
from gslcosim.errors import ContractError
from gslcosim.gateway.exchange import AnswerLateError, FrameExchange, StreamEndedError
from gslcosim.gateway.listener import Listener
from gslcosim.gateway.streams import PipeStream, Stream
from gslcosim.runtime.agents.guests import GATEWAY_VARIABLE, TOKEN_VARIABLE
from gslcosim.runtime.foreign.program import PARTICIPANT_VARIABLE

Kind = Literal["plain", "unknown fields", "missing inputs", "ending at once", "lost link"]
END_REASON = "the run is over"
_NAME = "participant"


@dataclass(frozen=True, kw_only=True)
class SessionScript:
    """What is played: under which name, with which seed, and what is special."""

    name: str
    seed: int
    kind: Kind = "plain"


@dataclass
class Played:
    """What came of a session: the first break of a rule if there was one, all answers, and how it ended."""

    script: SessionScript
    hello: ParticipantHello | None = None
    failure: Failure | None = None
    answers: dict[int, Mapping[str, Message]] = field(default_factory=dict[int, Mapping[str, Message]])
    hello_at_s: float = 0.0
    slowest_s: float = 0.0
    exit_code: int | None = None
    is_end_told: bool = False
    left_over: tuple[str, ...] = ()


class ParticipantSession:
    """Plays one script with one start of a program."""

    def __init__(
        self, wiring: Wiring, script: SessionScript, limits: FlightLimits, parameters: Mapping[str, ParameterValue]
    ) -> None:
        self._wiring = wiring
        self._limits = limits
        self._parameters = parameters
        self._started = StartedProcess(wiring)
        self._connected: queue.SimpleQueue[Stream] = queue.SimpleQueue()
        self._listener: Listener | None = None
        self._exchange: FrameExchange | None = None
        self.played = Played(script)

    def play(self) -> Played:
        """Play the script from the program's start to its end; nothing of it is left when this returns."""
        played = self.played
        answering = Answering(played.script.name)
        try:
            self._start()
            played.failure = self._greet(answering) or self._step(answering)
            self._end()
        finally:
            if self._listener is not None:
                self._listener.close()
            if self._exchange is not None:
                self._exchange.close_output()
                self._exchange.close_input()
            words = self._started.end_process()
            played.left_over = self._started.left_over
        if played.failure is not None and words:
            played.failure = answering.with_words(played.failure, words)
        return played

    def _start(self) -> None:
        started, wiring = self._started, self._wiring
        started.orphans.begin()
        variables = {PARTICIPANT_VARIABLE: _NAME, **started.orphans.variables}
        log, cwd = started.log, wiring.directory
        if wiring.door == "stdio":
            pipes = started.children.start_piped(_NAME, started.command(), variables=variables, log=log, cwd=cwd)
            self._connected.put(PipeStream(*pipes))
            return
        is_unix = wiring.door == "unix"
        listener = self._listener = (
            Listener.open_unix(started.folder / "gateway.sock") if is_unix else Listener.open_tcp()
        )
        listener.admit(wiring.format, lambda stream, _: self._connected.put(stream), lambda _: None)
        variables |= {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token}
        started.children.start_guest(_NAME, started.command(), variables=variables, log=log, cwd=cwd)

    # The first break of a rule up to the briefing.
    def _greet(self, answering: Answering) -> Failure | None:
        began_s, limit_s = time.monotonic(), self._limits.join_s
        expected = f"a ParticipantHello within {limit_s:g} s"
        exchange = self._exchange = self._opened(limit_s)
        if exchange is None:
            return answering.failure("hello", "its environment", expected, f"no connection{self._how()}")
        try:
            payload = exchange.receive(ParticipantHello, within_s=limit_s)
        except (StreamEndedError, AnswerLateError) as error:
            return answering.failure("hello", "its environment", expected, f"{error}{self._how()}")
        except ContractError as error:
            return answering.failure("encoding", "its environment", "a frame", str(error))
        hello, failure = failure_of_hello(answering, payload)
        if hello is None:
            return failure
        self.played.hello, self.played.hello_at_s = hello, time.monotonic() - began_s
        return self._tell(answering, briefing_of_check(hello, self.played.script.seed, self._parameters))

    def _step(self, answering: Answering) -> Failure | None:
        played = self.played
        hello = played.hello
        if hello is None or played.script.kind == "ending at once":
            return None
        inputs = ScriptedInputs(hello.reads, played.script.seed)
        for tick in TICKS:
            message = inputs.at(tick)
            if played.script.kind == "missing inputs" and tick < EMPTY_TICKS:
                message = message.model_copy(update={"inputs": {}})
            if failure := self._ask(answering, message, hello):
                return failure
        # What it may still have to say.
        return self._nothing_more(answering, f"the inputs up to tick {TICKS[-1]}", self._limits.settle_s)

    def _ask(self, answering: Answering, message: ParticipantInputs, hello: ParticipantHello) -> Failure | None:
        exchange, played, limit_s = self._exchange, self.played, self._limits.answer_s
        sent = f"ParticipantInputs, tick {message.tick}"
        if exchange is None:
            return None
        if failure := self._nothing_more(answering, f"what came before {sent}", 0.0):
            return failure
        asked_s = time.monotonic()
        if failure := self._tell(answering, message):
            return failure
        try:
            payload = exchange.receive(ParticipantOutputs, within_s=limit_s)
        except StreamEndedError as error:
            return answering.failure("stays", sent, "an answer, and a program that stays", f"{error}{self._how()}")
        except AnswerLateError as error:
            return answering.failure("answers", sent, f"ParticipantOutputs with tick {message.tick}", str(error))
        except ContractError as error:
            return answering.failure("encoding", sent, "a frame with ParticipantOutputs", str(error))
        played.slowest_s = max(played.slowest_s, time.monotonic() - asked_s)
        if _tick_of(payload) in played.answers and exchange.comes_within(self._limits.settle_s):
            # It was on its way when the inputs were told, and their answer comes behind it.
            return self._one_more(answering, sent)
        answers, failure = failure_of_outputs(answering, payload, message.tick, hello.writes)
        if answers is not None:
            played.answers[message.tick] = answers
        return failure

    def _nothing_more(self, answering: Answering, sent: str, within_s: float) -> Failure | None:
        exchange = self._exchange
        if exchange is None or not exchange.comes_within(within_s):
            return None
        return self._one_more(answering, sent)

    def _one_more(self, answering: Answering, sent: str) -> Failure:
        return answering.failure("once", sent, "nothing until the next inputs come", "one frame more")

    def _tell(self, answering: Answering, message: Message) -> Failure | None:
        exchange = self._exchange
        if exchange is None:
            return None
        is_later = self.played.script.kind == "unknown fields"
        payload = payload_of(with_later_fields(message)) if is_later else codec.encode(message)
        name = type(message).__name__
        try:
            exchange.send(name, payload, within_s=self._limits.answer_s)
        except StreamEndedError as error:
            return answering.failure("stays", name, "a program that stays", f"{error}{self._how()}")
        except AnswerLateError as error:
            return answering.failure("answers", name, "a program that reads", str(error))
        return None

    def _end(self) -> None:
        exchange, played = self._exchange, self.played
        if exchange is None or played.failure is not None:
            return
        played.is_end_told = True
        if played.script.kind != "lost link":
            self._tell(Answering(played.script.name), Ending(tick=0, reason=END_REASON))
        exchange.close_output()
        self._wait_for_exit(self._limits.exit_s)

    def _opened(self, limit_s: float) -> FrameExchange | None:
        deadline_s = time.monotonic() + limit_s
        while time.monotonic() < deadline_s and not (self._has_exited() and self._connected.empty()):
            try:
                return FrameExchange(self._connected.get(timeout=0.05), self._wiring.format)
            except queue.Empty:
                continue
        return None

    def _has_exited(self) -> bool:
        self._wait_for_exit(0.0)
        return self.played.exit_code is not None

    def _wait_for_exit(self, within_s: float) -> None:
        try:
            event = self._started.events.get(timeout=within_s) if within_s else self._started.events.get_nowait()
        except queue.Empty:
            return
        if isinstance(event, AgentExited):
            self.played.exit_code = event.exit_code

    def _how(self) -> str:
        self._wait_for_exit(self._limits.settle_s)
        code = self.played.exit_code
        return "" if code is None else f"; the process {exit_text(code)}"


def _tick_of(payload: bytes) -> int | None:
    try:
        tick = codec.unpack_foreign("ParticipantOutputs", payload).get("tick")
    except ContractError:
        return None
    return tick if type(tick) is int else None
