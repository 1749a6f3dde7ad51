"""Session of a check with a participant: its answers to scripted inputs, and the first rule that they break."""

import queue
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

from typing_extensions import override

from gslcosim.base.errors import ContractError
from gslcosim.base.processes import describe_exit
from gslcosim.contract import codec
from gslcosim.contract.messages import Ending, Message, ParameterValue
from gslcosim.contract.participant_messages import (
    VENTILATION,
    ParticipantHello,
    ParticipantInputs,
    ParticipantOutputs,
)
from gslcosim.gateway.connections import AnswerTimeoutError, BlockingConnection, Stream, StreamEndedError
from gslcosim.runtime.external.core import PARTICIPANT_VARIABLE
from gslcosim.runtime.external.protocol import is_valid_name, read_hello, read_outputs
from gslcosim_conformance.rules import Failure
from gslcosim_conformance.scripted_world import (
    INPUT_TICKS,
    N_EMPTY_TICKS,
    ScriptedInputs,
    add_later_fields,
    build_check_briefing,
    get_message_name,
    pack_fields,
)
from gslcosim_conformance.transcript import SessionLimits, SessionScript, Transcript
from gslcosim_conformance.transports import AgentExited, CheckedProcess, ConnectionSpec

END_REASON = "the run is over"
_PROCESS_NAME = "participant"


@dataclass
class ParticipantTranscript(Transcript):
    """All that happened in a session with a participant: its hello, its answers, and the first break of a rule."""

    hello: ParticipantHello | None = None
    hello_at_s: float | None = None
    failure: Failure | None = None
    outputs: dict[int, Mapping[str, Message]] = field(default_factory=dict[int, Mapping[str, Message]])
    slowest_s: float = 0.0

    @property
    @override
    def title(self) -> str:
        return f"the {self.script.name} session"

    @override
    def answers(self) -> dict[int, Mapping[str, Message]]:
        return self.outputs

    @override
    def describe_question(self, tick: int) -> str:
        return f"ParticipantInputs, tick {tick}"

    @override
    def format_answer(self, tick: int) -> str:
        text = ", ".join(f"{word}: {output}" for word, output in self.outputs.get(tick, {}).items())
        return text if len(text) <= 200 else f"{text[:197]}..."


def find_hello_failure(
    transcript: ParticipantTranscript, payload: bytes
) -> tuple[ParticipantHello | None, Failure | None]:
    """Return a program's hello, or the rule that it breaks."""
    sent = "its environment"
    try:
        codec.unpack_untrusted("ParticipantHello", payload)
    except ContractError as error:
        return None, transcript.build_failure("encoding", sent=sent, expected="one map", got=str(error))
    try:
        hello = read_hello(payload)
    except ContractError as error:
        rule = "contract" if str(error).startswith("contract:") else "hello"
        return None, transcript.build_failure(rule, sent=sent, expected="a ParticipantHello", got=str(error))
    problems = [f"reads {port!r}, which no run has" for port in hello.reads if get_message_name(port) is None]
    problems += [f"writes {word!r}, which is no name" for word in hello.writes if not is_valid_name(word)]
    for key, words in (("reads", hello.reads), ("writes", hello.writes)):
        problems += [f"{key} {word!r} twice" for word in dict.fromkeys(words) if words.count(word) > 1]
    if not hello.writes:
        problems.append("writes nothing")
    if problems:
        expected = f"ports of a run, and {VENTILATION} or words of its own, each once"
        return None, transcript.build_failure("ports", sent=sent, expected=expected, got="; ".join(problems))
    return hello, None


def find_outputs_failure(
    transcript: ParticipantTranscript, payload: bytes, tick: int, words: Iterable[str]
) -> tuple[Mapping[str, Message] | None, Failure | None]:
    """Return the answers of a program to the inputs of a tick, or the rule that they break."""
    sent, declared = f"ParticipantInputs, tick {tick}", tuple(words)
    try:
        fields = codec.unpack_untrusted("ParticipantOutputs", payload)
    except ContractError as error:
        return None, transcript.build_failure("encoding", sent=sent, expected="one map", got=str(error))
    try:
        return read_outputs(payload, tick, declared), None
    except ContractError as error:
        said = str(error)
    outputs = fields.get("outputs")
    if type(fields.get("tick")) is not int or fields["tick"] != tick:
        rule, expected = "tick", f"tick: {tick}"
    elif not isinstance(outputs, dict) or {*outputs} != {*declared}:
        rule, expected = "outputs", f"outputs with {', '.join(sorted(declared))}"
    else:
        rule, expected = "values", "finite numbers and truth values by name"
    return None, transcript.build_failure(rule, sent=sent, expected=expected, got=said)


class ParticipantSession:
    """Plays one script with one start of a program."""

    def __init__(
        self,
        connection: ConnectionSpec,
        script: SessionScript,
        limits: SessionLimits,
        parameters: Mapping[str, ParameterValue],
    ) -> None:
        self._limits = limits
        self._parameters = parameters
        self._process = CheckedProcess(connection)
        self._connected: queue.SimpleQueue[Stream] = queue.SimpleQueue()
        self._exchange: BlockingConnection | None = None
        self._began_s = time.monotonic()
        self._transcript = ParticipantTranscript(script)

    def play(self) -> ParticipantTranscript:
        """Play the script from the program's start to its end; nothing of it is left when this returns."""
        transcript = self._transcript
        try:
            self._process.start_behind_gateway(
                _PROCESS_NAME, {PARTICIPANT_VARIABLE: _PROCESS_NAME}, self._connected.put, lambda _: None
            )
            transcript.failure = self._greet() or self._step()
            self._end()
        finally:
            if self._exchange is not None:
                self._exchange.close_output()
                self._exchange.close_input()
            transcript.log_tail = self._process.end_process()
            transcript.leftover_processes = self._process.leftover_processes
        if (failure := transcript.failure) is not None:
            transcript.failure = replace(failure, got=transcript.append_log_tail(failure.got))
        return transcript

    # The first break of a rule up to the briefing.
    def _greet(self) -> Failure | None:
        transcript, began_s, limit_s = self._transcript, time.monotonic(), self._limits.join_s
        sent, expected = "its environment", f"a ParticipantHello within {limit_s:g} s"
        exchange = self._exchange = self._open_exchange(limit_s)
        if exchange is None:
            return self._fail("hello", sent, expected, f"no connection{self._describe_end()}")
        try:
            payload = exchange.receive(ParticipantHello, within_s=limit_s)
        except (StreamEndedError, AnswerTimeoutError) as error:
            return self._fail("hello", sent, expected, f"{error}{self._describe_end()}")
        except ContractError as error:
            return self._fail("encoding", sent, "a frame", str(error))
        hello, failure = find_hello_failure(transcript, payload)
        if hello is None:
            return failure
        transcript.hello, transcript.hello_at_s = hello, time.monotonic() - began_s
        return self._send(build_check_briefing(hello, transcript.script.seed, self._parameters))

    def _step(self) -> Failure | None:
        script, hello = self._transcript.script, self._transcript.hello
        if hello is None or script.variation == "ending at once":
            return None
        inputs = ScriptedInputs(hello.reads, script.seed)
        for tick in INPUT_TICKS:
            message = inputs.at(tick)
            if script.variation == "missing inputs" and tick < N_EMPTY_TICKS:
                message = message.model_copy(update={"inputs": {}})
            if failure := self._ask(message, hello):
                return failure
        # What it may still have to say.
        return self._find_surplus(f"the inputs up to tick {INPUT_TICKS[-1]}", self._limits.settle_s)

    def _ask(self, message: ParticipantInputs, hello: ParticipantHello) -> Failure | None:
        exchange, transcript, limit_s = self._exchange, self._transcript, self._limits.answer_s
        sent = transcript.describe_question(message.tick)
        if exchange is None:
            return None
        if failure := self._find_surplus(f"what came before {sent}", 0.0):
            return failure
        asked_s = time.monotonic()
        if failure := self._send(message):
            return failure
        try:
            payload = exchange.receive(ParticipantOutputs, within_s=limit_s)
        except StreamEndedError as error:
            got = f"{error}{self._describe_end()}"
            return self._fail("stays", sent, "an answer, and a program that stays", got)
        except AnswerTimeoutError as error:
            return self._fail("answers", sent, f"ParticipantOutputs with tick {message.tick}", str(error))
        except ContractError as error:
            return self._fail("encoding", sent, "a frame with ParticipantOutputs", str(error))
        transcript.slowest_s = max(transcript.slowest_s, time.monotonic() - asked_s)
        if _read_tick(payload) in transcript.outputs and exchange.comes_within(self._limits.settle_s):
            # It was on its way when the inputs were sent, and their answer comes behind it.
            return self._fail_surplus(sent)
        outputs, failure = find_outputs_failure(transcript, payload, message.tick, hello.writes)
        if outputs is not None:
            transcript.outputs[message.tick] = outputs
        return failure

    def _find_surplus(self, sent: str, within_s: float) -> Failure | None:
        exchange = self._exchange
        if exchange is None or not exchange.comes_within(within_s):
            return None
        return self._fail_surplus(sent)

    def _fail_surplus(self, sent: str) -> Failure:
        return self._fail("once", sent, "nothing until the next inputs come", "one frame more")

    def _send(self, message: Message) -> Failure | None:
        exchange = self._exchange
        if exchange is None:
            return None
        is_later = self._transcript.script.variation == "unknown fields"
        payload = pack_fields(add_later_fields(message)) if is_later else codec.encode(message)
        name = type(message).__name__
        try:
            exchange.send(name, payload, within_s=self._limits.answer_s)
        except StreamEndedError as error:
            return self._fail("stays", name, "a program that stays", f"{error}{self._describe_end()}")
        except AnswerTimeoutError as error:
            return self._fail("answers", name, "a program that reads", str(error))
        return None

    def _end(self) -> None:
        exchange, transcript = self._exchange, self._transcript
        if exchange is None or transcript.failure is not None:
            return
        transcript.end_sent_at_s = time.monotonic() - self._began_s
        if transcript.script.variation != "lost link":
            self._send(Ending(tick=0, reason=END_REASON))
        exchange.close_output()
        self._wait_for_exit(transcript.script.exit_within_s(self._limits))

    def _open_exchange(self, limit_s: float) -> BlockingConnection | None:
        deadline_s = time.monotonic() + limit_s
        while time.monotonic() < deadline_s and not (self._has_exited() and self._connected.empty()):
            try:
                return BlockingConnection(self._connected.get(timeout=0.05), self._process.connection.format)
            except queue.Empty:
                continue
        return None

    def _has_exited(self) -> bool:
        self._wait_for_exit(0.0)
        return self._transcript.exit_code is not None

    def _wait_for_exit(self, within_s: float) -> None:
        events = self._process.events
        try:
            event = events.get(timeout=within_s) if within_s else events.get_nowait()
        except queue.Empty:
            return
        if isinstance(event, AgentExited):
            self._transcript.exit_code = event.exit_code

    def _describe_end(self) -> str:
        self._wait_for_exit(self._limits.settle_s)
        code = self._transcript.exit_code
        return "" if code is None else f"; the process {describe_exit(code)}"

    def _fail(self, rule: str, sent: str, expected: str, got: str) -> Failure:
        return self._transcript.build_failure(rule, sent=sent, expected=expected, got=got)


def _read_tick(payload: bytes) -> int | None:
    try:
        tick = codec.unpack_untrusted("ParticipantOutputs", payload).get("tick")
    except ContractError:
        return None
    return tick if type(tick) is int else None
