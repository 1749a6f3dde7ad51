"""Check of a participant: scripted sessions with a program, its answers, and the rules that it breaks."""

import queue
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import msgpack

from gslcosim.base.errors import ContractError
from gslcosim.base.processes import describe_exit
from gslcosim.base.rng import stream
from gslcosim.base.ticks import seconds_from_ticks
from gslcosim.bus.interface import GATEWAY_VARIABLE, TOKEN_VARIABLE
from gslcosim.conformance.example_messages import load_example
from gslcosim.conformance.rules import PARTICIPANT_RULES, CheckReport, Failure, build_findings
from gslcosim.conformance.scripted_world import TICK_NS, add_unknown_fields
from gslcosim.conformance.session import SessionLimits
from gslcosim.conformance.transports import AgentExited, CheckedProcess, ConnectionSpec, OrphanProcesses
from gslcosim.contract import codec, keys
from gslcosim.contract.environment_messages import WIND, WindShare
from gslcosim.contract.keys import AGENT_PLACEHOLDER as ANY_AGENT
from gslcosim.contract.keys import KEY_TABLE
from gslcosim.contract.messages import Bounds, Ending, FieldSamples, Message, ParameterValue
from gslcosim.contract.participant_messages import (
    PARTICIPATION_VERSION,
    VENTILATION,
    ParticipantBriefing,
    ParticipantHello,
    ParticipantInputs,
    ParticipantOutputs,
    ParticipantValues,
    PortRead,
    PortWrite,
    VehicleOfRun,
    build_own_port,
)
from gslcosim.gateway.connections import (
    AnswerTimeoutError,
    BlockingConnection,
    Listener,
    PipeStream,
    Stream,
    StreamEndedError,
)
from gslcosim.methods.example_instruments import GAS, ROOM_M, SAMPLED_SENSORS, build_samples
from gslcosim.runtime.external.core import PARTICIPANT_VARIABLE
from gslcosim.runtime.external.protocol import is_valid_name, read_hello, read_outputs

PARTICIPANT_NAME = "model_1"
VEHICLE_NAME = "beetle"
# In a row, and over the places where integers get longer in msgpack.
INPUT_TICKS = (*range(40), *range(120, 131), *range(250, 260), *range(65_530, 65_540))
# Without any input, as at the beginning of a run where all have a delay.
N_EMPTY_TICKS = 5
_HIDDEN_KEYS = (keys.briefing(ANY_AGENT), keys.question(ANY_AGENT), keys.raw_command(ANY_AGENT), keys.ending(ANY_AGENT))
_OWN_PORT_PREFIX = build_own_port("", "").split("/")[0]


def get_message_name(port: str) -> str | None:
    """Return the type of the message on a port of a run, None where no run has such a port."""
    parts = port.split("/")
    if port == WIND:
        return WindShare.__name__
    if parts[0] == _OWN_PORT_PREFIX and len(parts) == 3 and all(parts):
        return ParticipantValues.__name__
    for channel in KEY_TABLE:
        wanted = channel.key.split("/")
        fits = len(parts) == len(wanted) and all(b == ANY_AGENT or a == b for a, b in zip(parts, wanted, strict=True))
        if fits and all(parts) and channel.key not in _HIDDEN_KEYS:
            return channel.message
    return None


def build_check_briefing(
    hello: ParticipantHello, seed: int, parameters: Mapping[str, ParameterValue]
) -> ParticipantBriefing:
    """Return the briefing of a participant."""
    return ParticipantBriefing(
        tick=0,
        participant=PARTICIPANT_NAME,
        contract_version=PARTICIPATION_VERSION,
        scenario="check",
        tick_ns=TICK_NS,
        period_ticks=1,
        seed=seed,
        time_limit_s=10_000.0,
        bounds=Bounds(min_m=(0.0, 0.0, 0.0), max_m=ROOM_M),
        gases=(GAS,),
        vehicles=(VehicleOfRun(agent=VEHICLE_NAME, sensors=SAMPLED_SENSORS),),
        reads=tuple(PortRead(port=port, delay_ticks=0, message=get_message_name(port) or "") for port in hello.reads),
        writes=tuple(_build_write(word) for word in hello.writes),
        parameters=dict(parameters),
    )


class ScriptedInputs:
    """One session's inputs. The same seed gives the same."""

    def __init__(self, reads: Iterable[str], seed: int) -> None:
        self._reads = tuple(reads)
        self._noise = stream(seed, "conformance.inputs")

    def at(self, tick: int) -> ParticipantInputs:
        """Return the inputs of a tick; to be called for each tick in turn."""
        inputs = {port: _build_input(port, tick, float(self._noise.standard_normal())) for port in self._reads}
        return ParticipantInputs(
            tick=tick,
            time_s=seconds_from_ticks(tick, TICK_NS),
            inputs={port: message.model_dump() for port, message in inputs.items()},
        )


def add_later_fields(message: Message) -> dict[str, Any]:
    """Return the fields of a message as a later minor version might send it, also within the inputs."""
    fields = message.model_dump()
    inputs: dict[str, Any] = fields.pop("inputs", {})
    later = add_unknown_fields(fields)
    if isinstance(message, ParticipantInputs):
        is_data = {port: get_message_name(port) == ParticipantValues.__name__ for port in inputs}
        later["inputs"] = {
            port: value if is_data[port] else add_unknown_fields(value) for port, value in inputs.items()
        }
    return later


def pack_fields(fields: Mapping[str, Any]) -> bytes:
    """Return fields as msgpack."""
    payload: Any = msgpack.packb(fields)
    return bytes(payload)


def _build_input(port: str, tick: int, noise: float) -> Message:
    name = get_message_name(port)
    if name == FieldSamples.__name__:
        return build_samples(tick, noise, agent=VEHICLE_NAME)
    if name == ParticipantValues.__name__:
        return ParticipantValues(tick=tick, values={"level": noise, "is_on": noise > 0})
    if name == WindShare.__name__:
        return WindShare(tick=tick, share=abs(noise))
    return load_example(name).model_copy(update={"tick": tick})


def _build_write(word: str) -> PortWrite:
    if word == VENTILATION:
        return PortWrite(word=word, port=WIND, message=WindShare.__name__)
    return PortWrite(word=word, port=build_own_port(PARTICIPANT_NAME, word), message=ParticipantValues.__name__)


@dataclass(frozen=True)
class FailureBuilder:
    """Makes failures of one session."""

    session: str

    def failure(self, rule: str, sent: str, expected: str, got: str) -> Failure:
        """Return a break of a rule."""
        return Failure(rule=rule, flight=self.session, sent=sent, expected=expected, got=got)

    def add_log_tail(self, failure: Failure, words: str) -> Failure:
        """Return a failure with the end of the program's log."""
        return replace(failure, got=f"{failure.got}\nThe end of its log: {words}")


def find_hello_failure(answering: FailureBuilder, payload: bytes) -> tuple[ParticipantHello | None, Failure | None]:
    """Return a program's hello, or the rule that it breaks."""
    sent = "its environment"
    try:
        codec.unpack_untrusted("ParticipantHello", payload)
    except ContractError as error:
        return None, answering.failure("encoding", sent, "one map", str(error))
    try:
        hello = read_hello(payload)
    except ContractError as error:
        rule = "contract" if str(error).startswith("contract:") else "hello"
        return None, answering.failure(rule, sent, "a ParticipantHello", str(error))
    problems = [f"reads {port!r}, which no run has" for port in hello.reads if get_message_name(port) is None]
    problems += [f"writes {word!r}, which is no name" for word in hello.writes if not is_valid_name(word)]
    for key, words in (("reads", hello.reads), ("writes", hello.writes)):
        problems += [f"{key} {word!r} twice" for word in dict.fromkeys(words) if words.count(word) > 1]
    if not hello.writes:
        problems.append("writes nothing")
    if problems:
        expected = f"ports of a run, and {VENTILATION} or words of its own, each once"
        return None, answering.failure("ports", sent, expected, "; ".join(problems))
    return hello, None


def find_outputs_failure(
    answering: FailureBuilder, payload: bytes, tick: int, words: Iterable[str]
) -> tuple[Mapping[str, Message] | None, Failure | None]:
    """Return the answers of a program to the inputs of a tick, or the rule that they break."""
    sent, declared = f"ParticipantInputs, tick {tick}", tuple(words)
    try:
        fields = codec.unpack_untrusted("ParticipantOutputs", payload)
    except ContractError as error:
        return None, answering.failure("encoding", sent, "one map", str(error))
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
    return None, answering.failure(rule, sent, expected, said)


SessionKind = Literal["plain", "unknown fields", "missing inputs", "ending at once", "lost link"]
END_REASON = "the run is over"
_PROCESS_NAME = "participant"


@dataclass(frozen=True, kw_only=True)
class SessionScript:
    """Script of a session: its name, its seed, and what is special."""

    name: str
    seed: int
    kind: SessionKind = "plain"


@dataclass
class SessionResult:
    """Result of a session: the first break of a rule if there was one, all answers, and how it ended."""

    script: SessionScript
    hello: ParticipantHello | None = None
    failure: Failure | None = None
    answers: dict[int, Mapping[str, Message]] = field(default_factory=dict[int, Mapping[str, Message]])
    hello_at_s: float = 0.0
    slowest_s: float = 0.0
    exit_code: int | None = None
    is_end_sent: bool = False
    leftover_processes: tuple[str, ...] = ()


class ParticipantSession:
    """Plays one script with one start of a program."""

    def __init__(
        self,
        connection: ConnectionSpec,
        script: SessionScript,
        limits: SessionLimits,
        parameters: Mapping[str, ParameterValue],
    ) -> None:
        self._wiring = connection
        self._limits = limits
        self._parameters = parameters
        self._started = CheckedProcess(connection)
        self._connected: queue.SimpleQueue[Stream] = queue.SimpleQueue()
        self._listener: Listener | None = None
        self._exchange: BlockingConnection | None = None
        self.played = SessionResult(script)

    def play(self) -> SessionResult:
        """Play the script from the program's start to its end; nothing of it is left when this returns."""
        played = self.played
        answering = FailureBuilder(played.script.name)
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
            played.leftover_processes = self._started.leftover_processes
        if played.failure is not None and words:
            played.failure = answering.add_log_tail(played.failure, words)
        return played

    def _start(self) -> None:
        started, connection = self._started, self._wiring
        started.orphans.begin()
        variables = {PARTICIPANT_VARIABLE: _PROCESS_NAME, **started.orphans.variables}
        log, cwd = started.log, connection.directory
        if connection.transport == "stdio":
            pipes = started.children.start_piped(
                _PROCESS_NAME, started.command(), variables=variables, log=log, cwd=cwd
            )
            self._connected.put(PipeStream(*pipes))
            return
        is_unix = connection.transport == "unix"
        listener = self._listener = (
            Listener.open_unix(started.folder / "gateway.sock") if is_unix else Listener.open_tcp()
        )
        listener.admit(connection.format, lambda stream, _: self._connected.put(stream), lambda _: None)
        variables |= {GATEWAY_VARIABLE: listener.address, TOKEN_VARIABLE: listener.token}
        started.children.start(_PROCESS_NAME, started.command(), variables=variables, log=log, cwd=cwd)

    # The first break of a rule up to the briefing.
    def _greet(self, answering: FailureBuilder) -> Failure | None:
        began_s, limit_s = time.monotonic(), self._limits.join_s
        expected = f"a ParticipantHello within {limit_s:g} s"
        exchange = self._exchange = self._opened(limit_s)
        if exchange is None:
            return answering.failure("hello", "its environment", expected, f"no connection{self._how()}")
        try:
            payload = exchange.receive(ParticipantHello, within_s=limit_s)
        except (StreamEndedError, AnswerTimeoutError) as error:
            return answering.failure("hello", "its environment", expected, f"{error}{self._how()}")
        except ContractError as error:
            return answering.failure("encoding", "its environment", "a frame", str(error))
        hello, failure = find_hello_failure(answering, payload)
        if hello is None:
            return failure
        self.played.hello, self.played.hello_at_s = hello, time.monotonic() - began_s
        return self._send_message(answering, build_check_briefing(hello, self.played.script.seed, self._parameters))

    def _step(self, answering: FailureBuilder) -> Failure | None:
        played = self.played
        hello = played.hello
        if hello is None or played.script.kind == "ending at once":
            return None
        inputs = ScriptedInputs(hello.reads, played.script.seed)
        for tick in INPUT_TICKS:
            message = inputs.at(tick)
            if played.script.kind == "missing inputs" and tick < N_EMPTY_TICKS:
                message = message.model_copy(update={"inputs": {}})
            if failure := self._ask(answering, message, hello):
                return failure
        # What it may still have to say.
        return self._nothing_more(answering, f"the inputs up to tick {INPUT_TICKS[-1]}", self._limits.settle_s)

    def _ask(self, answering: FailureBuilder, message: ParticipantInputs, hello: ParticipantHello) -> Failure | None:
        exchange, played, limit_s = self._exchange, self.played, self._limits.answer_s
        sent = f"ParticipantInputs, tick {message.tick}"
        if exchange is None:
            return None
        if failure := self._nothing_more(answering, f"what came before {sent}", 0.0):
            return failure
        asked_s = time.monotonic()
        if failure := self._send_message(answering, message):
            return failure
        try:
            payload = exchange.receive(ParticipantOutputs, within_s=limit_s)
        except StreamEndedError as error:
            return answering.failure("stays", sent, "an answer, and a program that stays", f"{error}{self._how()}")
        except AnswerTimeoutError as error:
            return answering.failure("answers", sent, f"ParticipantOutputs with tick {message.tick}", str(error))
        except ContractError as error:
            return answering.failure("encoding", sent, "a frame with ParticipantOutputs", str(error))
        played.slowest_s = max(played.slowest_s, time.monotonic() - asked_s)
        if _read_tick(payload) in played.answers and exchange.comes_within(self._limits.settle_s):
            # It was on its way when the inputs were sent, and their answer comes behind it.
            return self._one_more(answering, sent)
        answers, failure = find_outputs_failure(answering, payload, message.tick, hello.writes)
        if answers is not None:
            played.answers[message.tick] = answers
        return failure

    def _nothing_more(self, answering: FailureBuilder, sent: str, within_s: float) -> Failure | None:
        exchange = self._exchange
        if exchange is None or not exchange.comes_within(within_s):
            return None
        return self._one_more(answering, sent)

    def _one_more(self, answering: FailureBuilder, sent: str) -> Failure:
        return answering.failure("once", sent, "nothing until the next inputs come", "one frame more")

    def _send_message(self, answering: FailureBuilder, message: Message) -> Failure | None:
        exchange = self._exchange
        if exchange is None:
            return None
        is_later = self.played.script.kind == "unknown fields"
        payload = pack_fields(add_later_fields(message)) if is_later else codec.encode(message)
        name = type(message).__name__
        try:
            exchange.send(name, payload, within_s=self._limits.answer_s)
        except StreamEndedError as error:
            return answering.failure("stays", name, "a program that stays", f"{error}{self._how()}")
        except AnswerTimeoutError as error:
            return answering.failure("answers", name, "a program that reads", str(error))
        return None

    def _end(self) -> None:
        exchange, played = self._exchange, self.played
        if exchange is None or played.failure is not None:
            return
        played.is_end_sent = True
        if played.script.kind != "lost link":
            self._send_message(FailureBuilder(played.script.name), Ending(tick=0, reason=END_REASON))
        exchange.close_output()
        self._wait_for_exit(self._limits.exit_s)

    def _opened(self, limit_s: float) -> BlockingConnection | None:
        deadline_s = time.monotonic() + limit_s
        while time.monotonic() < deadline_s and not (self._has_exited() and self._connected.empty()):
            try:
                return BlockingConnection(self._connected.get(timeout=0.05), self._wiring.format)
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
        return "" if code is None else f"; the process {describe_exit(code)}"


def _read_tick(payload: bytes) -> int | None:
    try:
        tick = codec.unpack_untrusted("ParticipantOutputs", payload).get("tick")
    except ContractError:
        return None
    return tick if type(tick) is int else None


SEED, OTHER_SEED = 20_230_117, 7
# So that a program that draws by the clock's seconds does not look right.
MIN_START_INTERVAL_S = 1.1
_SESSION_RULES = ("hello", "ports", "contract", "answers", "encoding", "tick", "outputs", "values", "once", "stays")
_LATER_SESSIONS: dict[str, tuple[SessionKind, str]] = {
    "unknown-fields": ("unknown fields", ", with fields of a later minor version such as x_text and x_list"),
    "missing-inputs": ("missing inputs", ""),
}


def check_participant(
    connection: ConnectionSpec,
    limits: SessionLimits | None = None,
    parameters: Mapping[str, ParameterValue] = MappingProxyType({}),
    report_progress: Callable[[str], None] = lambda _: None,
) -> CheckReport:
    """Return what a check finds out about a participant.

    Args:
        connection: How it is started and spoken to.
        limits: How long it is waited for.
        parameters: What its briefing hands to it.
        report_progress: Gets the name of each session before it begins.

    Raises:
        UsageError: there is no such program.
    """
    connection.check()
    return ParticipantCheck(connection, limits or SessionLimits(), parameters, report_progress).run()


@dataclass
class ParticipantCheck:
    """One participant under check: what was played with it, and the rules that it has broken so far."""

    connection: ConnectionSpec
    limits: SessionLimits
    parameters: Mapping[str, ParameterValue]
    report_progress: Callable[[str], None]
    failures: dict[str, Failure] = field(default_factory=dict[str, Failure])
    unjudged: dict[str, str] = field(default_factory=dict[str, str])
    notes: dict[str, str] = field(default_factory=dict[str, str])
    _started_at_s: float = 0.0

    def run(self) -> CheckReport:
        """Play all sessions that still can say something; return the report."""
        first = self._play("first", "plain")
        if first.failure is not None:
            self._add(first.failure)
            self._leave_unjudged(first.failure.rule)
        else:
            self._judge_end(first, "ending", "exit-code")
            self._note_pace(first)
            self._repeat_all(first)
        beyond = {} if OrphanProcesses.is_possible() else {"leaves-nothing": "this system does not tell"}
        hello = first.hello
        ports = (
            () if hello is None else (f"It reads {_join_words(hello.reads)} and writes {_join_words(hello.writes)}.",)
        )
        rules = PARTICIPANT_RULES
        return CheckReport(
            command=self.connection.command,
            transport=self.connection.transport,
            format=self.connection.format,
            findings=build_findings(
                self.connection.transport, self.failures, self.unjudged, self.notes, beyond, rules=rules
            ),
            notes=ports,
        )

    def _repeat_all(self, first: SessionResult) -> None:
        second = self._play("again", "plain")
        if second.failure is not None:
            self._add(_relabel("restart", second.failure))
            for rule in ("determinism", *_LATER_SESSIONS, "early-ending", "stream-end"):
                self.unjudged[rule] = "needs a second start"
            return
        self._add(_find_difference("determinism", first, second, sent=", as before"))
        for rule, (kind, sent) in _LATER_SESSIONS.items():
            played = self._play(kind, kind)
            if played.failure is not None:
                self._add(_relabel(rule, played.failure))
            elif rule == "unknown-fields" and "determinism" not in self.failures:
                self._add(_find_difference(rule, first, played, sent=sent))
        early = self._play("ending at once", "ending at once")
        if early.failure is None:
            self._judge_end(early, "early-ending", "early-ending")
        else:
            self._add(_relabel("early-ending", early.failure))
        lost = self._play("lost link", "lost link", seed=OTHER_SEED)
        if lost.failure is None:
            self._judge_end(lost, "stream-end", None)
        else:
            self._add(_relabel("stream-end", lost.failure))

    def _judge_end(self, played: SessionResult, rule: str, rule_of_code: str | None) -> None:
        sent = "the end of its stream" if played.script.kind == "lost link" else "Ending"
        within = f"{self.limits.exit_s:g} s"
        if played.exit_code is None:
            self._add(_build_failure(rule, played, sent, f"an exit within {within}", "it still runs"))
            if rule_of_code is not None and rule_of_code != rule:
                self.unjudged[rule_of_code] = f"first put right: {rule}"
        elif rule_of_code is not None and played.exit_code != 0:
            self._add(
                _build_failure(
                    rule_of_code, played, sent, "exit code 0", f"the process {describe_exit(played.exit_code)}"
                )
            )

    def _leave_unjudged(self, rule: str) -> None:
        reason = f"first put right: {rule}"
        later = [each for each in PARTICIPANT_RULES if each not in (*_SESSION_RULES, "leaves-nothing")]
        passed = _SESSION_RULES[: _SESSION_RULES.index(rule)] if rule in ("hello", "ports", "contract") else ()
        blocked = _SESSION_RULES if rule in ("hello", "ports", "contract") else ()
        for each in (*later, *(name for name in blocked if name not in (*passed, rule))):
            self.unjudged[each] = reason

    def _note_pace(self, first: SessionResult) -> None:
        self.notes["hello"] = f"after {first.hello_at_s:.1f} s"
        self.notes["answers"] = f"slowest {1e3 * first.slowest_s:.1f} ms of {self.limits.answer_s:g} s"

    def _play(self, name: str, kind: SessionKind, seed: int = SEED) -> SessionResult:
        self.report_progress(name)
        time.sleep(max(0.0, self._started_at_s + MIN_START_INTERVAL_S - time.monotonic()))
        self._started_at_s = time.monotonic()
        script = SessionScript(name=name, seed=seed, kind=kind)
        played = ParticipantSession(self.connection, script, self.limits, self.parameters).play()
        if played.leftover_processes:
            self._add(
                _build_failure(
                    "leaves-nothing", played, "Ending", "no process left", ", ".join(played.leftover_processes)
                )
            )
        return played

    def _add(self, failure: Failure | None) -> None:
        if failure is not None:
            self.failures.setdefault(failure.rule, failure)


def _find_difference(rule: str, first: SessionResult, later: SessionResult, *, sent: str) -> Failure | None:
    for tick, answers in first.answers.items():
        now = later.answers.get(tick)
        if answers != now:
            shown = [_format_answers(each) for each in (answers, now or {})]
            inputs = f"ParticipantInputs, tick {tick}{sent}"
            return _build_failure(rule, later, inputs, f"{shown[0]}, as in the first session", shown[1])
    return None


def _format_answers(answers: Mapping[str, object]) -> str:
    text = ", ".join(f"{word}: {answer}" for word, answer in answers.items())
    return text if len(text) <= 200 else f"{text[:197]}..."


def _build_failure(rule: str, played: SessionResult, sent: str, expected: str, got: str) -> Failure:
    return Failure(rule=rule, flight=played.script.name, sent=sent, expected=expected, got=got)


def _relabel(rule: str, failure: Failure) -> Failure:
    return Failure(
        rule=rule,
        flight=failure.flight,
        sent=failure.sent,
        expected=failure.expected,
        got=f"{failure.got} ({failure.rule})",
    )


def _join_words(words: tuple[str, ...]) -> str:
    return ", ".join(words) or "nothing"


__all__ = ["PARTICIPANT_RULES", "check_participant"]
