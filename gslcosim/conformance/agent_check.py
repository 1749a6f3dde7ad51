"""Check of an agent: sessions one after the other, and the rules that their transcripts break."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from gslcosim.base.processes import describe_exit
from gslcosim.conformance.answers import format_command
from gslcosim.conformance.rules import RULES, CheckReport, Failure, build_findings
from gslcosim.conformance.session import (
    BELIEF_PERIOD_TICKS,
    MAX_SURPLUS_MESSAGES,
    Question,
    ReceivedAnswer,
    ScriptedSession,
    SessionLimits,
    SessionScript,
    Transcript,
    Variation,
)
from gslcosim.conformance.transports import ConnectionSpec, OrphanProcesses, open_transport
from gslcosim.contract.messages import Command

# After one of these the rest of a check would only repeat it in other words.
STOPPING_RULES = frozenset(
    {
        "joins",
        "listens-first",
        "answers",
        "deadline",
        "size",
        "encoding",
        "contract",
        "integers",
        "tick",
        "finite",
        "byte-order",
        "schema",
        "flood",
        "stays",
    }
)


def find_session_failures(transcript: Transcript, limits: SessionLimits) -> dict[str, Failure]:
    """Return the rules broken in one run, each with its first break; how the agent ends is not part of it."""
    found: dict[str, Failure] = {}
    for failure in _iter_failures(transcript, limits):
        found.setdefault(failure.rule, failure)
    if transcript.leftover_processes:
        got = f"{', '.join(transcript.leftover_processes)}, which the check has ended"
        found |= _build_failures(
            transcript, "leaves-nothing", sent="", expected="no process of it after its end", got=got
        )
    return found


def find_ending_failures(transcript: Transcript, limits: SessionLimits) -> dict[str, Failure]:
    """Return the rules broken after the agent was sent the end: `ending` or `exit-code`."""
    if transcript.end_sent_at_s is None:
        return {}
    sent = "Ending" if transcript.script.variation != "lost link" else "nothing; the link was cut"
    if transcript.exited_at_s is None:
        limit_s, start_s = transcript.script.exit_within_s(limits), transcript.script.start_s
        starting = f" ({start_s:.1f} s of them to start, as before)" if start_s else ""
        expected, got = f"an exit within {limit_s:.3g} s{starting}", f"it still runs {limit_s:.3g} s later"
        return _build_failures(transcript, "ending", sent=sent, expected=expected, got=f"{got}, and was ended by force")
    if transcript.exit_code:
        got = describe_exit(transcript.exit_code) + _format_log_tail(transcript)
        return _build_failures(transcript, "exit-code", sent=sent, expected="exit code 0", got=got)
    return {}


def relabel_failure(rule: str, failures: dict[str, Failure]) -> dict[str, Failure]:
    """Return the first of some failures as the break of another rule."""
    first = next(iter(failures.values()), None)
    return {} if first is None else {rule: _relabel(rule, first)}


def find_difference(rule: str, first: Transcript, second: Transcript, *, sent: str) -> dict[str, Failure]:
    """Return where the commands of two runs begin to differ, as the break of a rule."""
    before, after = first.commands(), second.commands()
    for tick in sorted({*before, *after}):
        if not are_commands_equal(before.get(tick), after.get(tick)):
            return _build_failures(
                second,
                rule,
                sent=f"{_describe_observation(tick)}{sent}",
                expected=f"{_format_command(before.get(tick))}, as in the flight '{first.script.name}'",
                got=_format_command(after.get(tick)),
            )
    return {}


def find_repeat_failures(transcript: Transcript, *, may_answer_more: bool) -> dict[str, Failure]:
    """Return where an observation that came again was not answered again, or not with the same bytes.

    `may_answer_more` says that it is known already that the agent answers more than once.
    """
    for question in transcript.questions:
        answers = [arrival.answer for arrival in transcript.answers_to(question)]
        if question.n_sent == 1 or not answers:
            continue
        sent = f"{_describe_observation(question.tick)} again, after its answer and another briefing"
        expected = f"the same bytes as before: {answers[0].shown}"
        if len(answers) < question.n_sent:
            return _build_failures(transcript, "repeats", sent=sent, expected=expected, got="nothing")
        if len(answers) > question.n_sent and not may_answer_more:
            got = f"{len(answers)} answers to {question.n_sent} observations"
            return _build_failures(transcript, "repeats", sent=sent, expected=expected, got=got)
        if any(answer.payload != answers[0].payload for answer in answers):
            got = f"{answers[-1].shown} ({len(answers[-1].payload)} bytes, not the same)"
            return _build_failures(transcript, "repeats", sent=sent, expected=expected, got=got)
    return {}


def are_commands_equal(first: Command | None, second: Command | None) -> bool:
    """Return whether two commands are the same to a run: what one says of its contract does not count."""
    if first is None or second is None:
        return first is second
    return first.model_copy(update={"contract": None}) == second.model_copy(update={"contract": None})


def get_slowest_answer_s(transcript: Transcript) -> float | None:
    """Return the longest time from a question to its answer [s]."""
    answered = [question for question in transcript.questions if transcript.answers_to(question)]
    return max((transcript.answers_to(q)[0].at_s - q.sent_at_s for q in answered), default=None)


def _iter_failures(transcript: Transcript, limits: SessionLimits) -> Iterator[Failure]:
    if transcript.joined_at_s is None or _find_early_death(transcript):
        yield _find_absence(transcript, limits)
        return
    if transcript.unsubscribed_keys:
        expected = f"subscriptions to {', '.join(transcript.unsubscribed_keys)} before the token"
        yield _build_failure(transcript, "listens-first", sent="", expected=expected, got="a token without them")
        return
    if transcript.n_surplus > MAX_SURPLUS_MESSAGES:
        n_asked = sum(question.n_sent for question in transcript.questions)
        expected = f"{n_asked} commands, one for each observation that awaited one"
        yield _build_failure(
            transcript,
            "flood",
            sent=f"{n_asked} observations that await a command",
            expected=expected,
            got=f"{transcript.n_arrivals} messages, and then the check gave up",
        )
    else:
        for question in transcript.questions:
            yield from _find_question_failures(transcript, question, limits)
        yield from _find_unasked_failures(transcript)
        yield from _find_belief_failures(transcript)
    yield from _find_access_failures(transcript)
    yield from _find_early_leave(transcript)


# Over stdio an agent has joined as soon as it is started. One that is gone without a word has never really come.
def _find_early_death(transcript: Transcript) -> bool:
    is_over = transcript.exited_at_s is not None and transcript.end_sent_at_s is None
    is_first = transcript.joins_by_start and transcript.script.variation == "plain"
    is_mute = not transcript.n_arrivals and len(transcript.questions) <= 1
    return is_first and is_over and is_mute


def _find_absence(transcript: Transcript, limits: SessionLimits) -> Failure:
    got = f"nothing for {limits.join_s:g} s"
    if transcript.exited_at_s is not None:
        got = f"the process {describe_exit(transcript.exit_code or 0)} after {transcript.exited_at_s:.1f} s"
    if transcript.unexpected_messages:
        got += f"; but {transcript.unexpected_messages[0]}"
    expected = f"an agent that has joined within {limits.join_s:g} s, and lives"
    return _build_failure(
        transcript, "joins", sent="its environment", expected=expected, got=got + _format_log_tail(transcript)
    )


def _find_question_failures(transcript: Transcript, question: Question, limits: SessionLimits) -> Iterator[Failure]:
    sent = _describe_observation(question.tick)
    answers = transcript.answers_to(question)
    others = [a for a in transcript.arrivals if a.open_tick == question.tick and a not in answers]
    for arrival in (*answers[:1], *others):
        if problem := arrival.answer.problem:
            got = _append_fault(problem.got, arrival)
            yield _build_failure(
                transcript, problem.rule, sent=sent, expected=problem.expected, got=got, remedy=problem.remedy
            )
    if answers:
        waited_s = answers[0].at_s - question.sent_at_s
        if waited_s > limits.answer_s:
            expected, got = f"an answer within {limits.answer_s:g} s", f"one after {waited_s:.2f} s"
            yield _build_failure(transcript, "deadline", sent=sent, expected=expected, got=got)
        if len(answers) > question.n_sent and transcript.script.variation != "repeats":
            got = f"{len(answers)}: {answers[0].answer.shown}; {answers[1].answer.shown}"
            yield _build_failure(transcript, "once", sent=sent, expected="one command", got=got)
    elif wrong := [arrival for arrival in others if arrival.answer.command]:
        got = _append_fault(wrong[0].answer.shown, wrong[0])
        yield _build_failure(transcript, "tick", sent=sent, expected=f"a Command with tick {question.tick}", got=got)
    elif not others and not _has_left_early(transcript):
        got = f"nothing within {2 * limits.answer_s:g} s"
        yield _build_failure(transcript, "answers", sent=sent, expected=f"a Command with tick {question.tick}", got=got)


# What came while no question was open, and commands for observations that asked for none, beside the right answer.
def _find_unasked_failures(transcript: Transcript) -> Iterator[Failure]:
    asked = {question.tick for question in transcript.questions}
    answered = {question.tick for question in transcript.questions if transcript.answers_to(question)}
    for arrival in transcript.arrivals:
        answer = arrival.answer
        if arrival.open_tick is None and answer.problem is not None:
            problem, got = answer.problem, _append_fault(answer.problem.got, arrival)
            yield _build_failure(
                transcript, problem.rule, sent="", expected=problem.expected, got=got, remedy=problem.remedy
            )
        elif answer.command is not None and answer.tick not in asked and arrival.open_tick in {None, *answered}:
            sent = (
                "the briefing"
                if not transcript.sent_ticks
                else f"Observation, tick {answer.tick}, awaiting_command false"
            )
            sent = sent if answer.tick in transcript.sent_ticks else f"no observation of tick {answer.tick}"
            got = _append_fault(answer.shown, arrival)
            yield _build_failure(transcript, "unasked", sent=sent, expected="no command", got=got)


# The vehicle would fly all the same: the validator passes a command without a belief that comes too soon.
def _find_belief_failures(transcript: Transcript) -> Iterator[Failure]:
    last: int | None = None
    for tick, command in sorted(transcript.commands().items()):
        if command.belief is None:
            continue
        if last is not None and tick - last < BELIEF_PERIOD_TICKS:
            got = f"beliefs at ticks {last} and {tick}"
            expected = f"beliefs at least {BELIEF_PERIOD_TICKS} ticks apart"
            yield _build_failure(transcript, "beliefs", sent=_describe_observation(tick), expected=expected, got=got)
        last = tick


def _find_access_failures(transcript: Transcript) -> Iterator[Failure]:
    if transcript.unexpected_messages:
        yield _build_failure(
            transcript,
            "own-key",
            sent="",
            expected="messages on agents/<name>/command and the token agents/<name>/alive only",
            got=f"{', '.join(sorted({*transcript.unexpected_messages})[:5])}. In a run the router denies it.",
        )
    reached = [f"a subscription that includes {key}" for key in transcript.foreign_subscriptions]
    reached += [f"a query of {key}" for key in sorted({*transcript.queries})]
    if reached:
        yield _build_failure(
            transcript,
            "own-ears",
            sent="",
            expected="subscriptions to agents/<name>/briefing, observation and ending only",
            got=f"{', '.join(reached[:5])}. In a run the router denies it.",
        )


def _find_early_leave(transcript: Transcript) -> Iterator[Failure]:
    if not _has_left_early(transcript) or transcript.is_abandoned:
        return
    how = transcript.left_how
    if transcript.exited_at_s is not None:
        how = f"the process {describe_exit(transcript.exit_code or 0)}"
    last = max(transcript.sent_ticks, default=None)
    sent = "the briefing" if last is None else f"observations up to tick {last}, and no Ending"
    got = f"{how} before the end of the run{_format_log_tail(transcript)}"
    yield _build_failure(transcript, "stays", sent=sent, expected="an agent that stays", got=got)


def _has_left_early(transcript: Transcript) -> bool:
    times = [at for at in (transcript.exited_at_s, transcript.left_at_s) if at is not None]
    end_s = transcript.end_sent_at_s
    return bool(times) and (end_s is None or min(times) < end_s)


def _build_failures(transcript: Transcript, rule: str, *, sent: str, expected: str, got: str) -> dict[str, Failure]:
    return {rule: _build_failure(transcript, rule, sent=sent, expected=expected, got=got)}


def _build_failure(
    transcript: Transcript, rule: str, *, sent: str, expected: str, got: str, remedy: str = ""
) -> Failure:
    sent = sent or "the briefing and observations"
    return Failure(rule=rule, flight=transcript.script.name, sent=sent, expected=expected, got=got, remedy=remedy)


def _relabel(rule: str, failure: Failure) -> Failure:
    return Failure(
        rule=rule,
        flight=failure.flight,
        sent=failure.sent,
        expected=failure.expected,
        got=f"{failure.got} ({failure.rule})",
        remedy=failure.remedy,
    )


def _describe_observation(tick: int) -> str:
    return f"Observation, tick {tick}, awaiting_command true"


def _format_command(command: Command | None) -> str:
    return f"Command {format_command(command)}" if command else "nothing"


def _append_fault(got: str, arrival: ReceivedAnswer) -> str:
    return f"{got}\nA run would say: {arrival.fault}" if arrival.fault and arrival.fault not in got else got


def _format_log_tail(transcript: Transcript) -> str:
    return f"\nThe end of its log: {transcript.log_tail}" if transcript.log_tail else ""


SEED, OTHER_SEED = 20_230_117, 7
# So that an agent that seeds with the clock's seconds does not look right.
MIN_START_INTERVAL_S = 1.1
# A start may take so many times as long as the slowest one before.
START_FACTOR = 2.0
_VARIATIONS: dict[str, tuple[Variation, str]] = {
    "unknown-fields": ("unknown fields", ", with fields of a later minor version such as x_text and x_list"),
    "optional-fields": ("optional fields", ", without the fields that have a default"),
    "repeats": ("repeats", ", some of them sent again after the answer"),
}
_LATER_RULES = ("restart", "determinism", *_VARIATIONS, "early-ending", "stream-end")
_SESSION_RULES = tuple(rule for rule in RULES if rule not in (*_LATER_RULES, "joins", "ending", "exit-code"))


def check_agent(
    connection: ConnectionSpec,
    limits: SessionLimits | None = None,
    report_progress: Callable[[str], None] = lambda _: None,
) -> CheckReport:
    """Return what a check finds out about an agent.

    Args:
        connection: How it is started and spoken to.
        limits: How long it is waited for.
        report_progress: Gets the name of each run before it begins.

    Raises:
        UsageError: there is no such program.
    """
    connection.check()
    return AgentCheck(connection, limits or SessionLimits(), report_progress).run()


@dataclass
class AgentCheck:
    """One agent under check: what was played with it, and the rules it has broken so far."""

    connection: ConnectionSpec
    limits: SessionLimits
    report_progress: Callable[[str], None]
    failures: dict[str, Failure] = field(default_factory=dict[str, Failure])
    unjudged: dict[str, str] = field(default_factory=dict[str, str])
    notes: dict[str, str] = field(default_factory=dict[str, str])
    remarks: list[str] = field(default_factory=list[str])
    _started_at: float = 0.0
    _start_s: float = 0.0

    def run(self) -> CheckReport:
        """Play all runs that still can say something; return the report."""
        first = self._play("first", "plain")
        found = find_session_failures(first, self.limits)
        self._add(found, {} if "listens-first" in found else find_ending_failures(first, self.limits))
        if STOPPING_RULES & found.keys():
            self._leave_unjudged(first, found)
        else:
            self._note_pace(first)
            self._repeat_all(first)
        beyond = {} if OrphanProcesses.is_possible() else {"leaves-nothing": "this system does not tell"}
        findings = build_findings(self.connection.transport, self.failures, self.unjudged, self.notes, beyond)
        return CheckReport(
            command=self.connection.command,
            transport=self.connection.transport,
            format=self.connection.format,
            findings=findings,
            notes=tuple(self.remarks),
        )

    def _repeat_all(self, first: Transcript) -> None:
        second = self._play("again", "plain")
        broken = find_session_failures(second, self.limits)
        if STOPPING_RULES & broken.keys():
            self._add(relabel_failure("restart", broken))
            for rule in _LATER_RULES[1:]:
                self.unjudged[rule] = "needs a second start"
            return
        self._add(find_difference("determinism", first, second, sent=", as before"))
        for rule, (variation, sent) in _VARIATIONS.items():
            if rule != "repeats" or self.connection.transport == "zenoh":
                self._vary(rule, variation, sent, first)
        self._end_otherwise(first)

    # Whoever draws at random cannot be compared with itself; it must still answer rightly.
    def _vary(self, rule: str, variation: Variation, sent: str, first: Transcript) -> None:
        flight = self._play(variation, variation)
        broken = find_session_failures(flight, self.limits)
        if STOPPING_RULES & broken.keys():
            self._add(relabel_failure(rule, broken))
            return
        if rule == "repeats":
            self._add(find_repeat_failures(flight, may_answer_more="once" in self.failures))
        if "determinism" in self.failures:
            self.notes[rule] = "answered rightly; whether as before cannot be told while determinism fails"
        else:
            self._add(find_difference(rule, first, flight, sent=sent))

    def _end_otherwise(self, first: Transcript) -> None:
        if {"ending", "exit-code"} & self.failures.keys():
            self.unjudged["early-ending"] = "first let it end rightly after a flight"
        else:
            early = self._play("ending at once", "ending at once", start_s=START_FACTOR * self._start_s)
            self._judge_end("early-ending", early)
        lost = self._play("lost link", "lost link", seed=OTHER_SEED)
        self._judge_end("stream-end", lost)
        is_same = not find_difference("", first, lost, sent="")
        self.remarks.append(
            f"With another seed it sends {'the same' if is_same else 'other'} commands; both is allowed."
        )

    def _judge_end(self, rule: str, flight: Transcript) -> None:
        broken = find_session_failures(flight, self.limits)
        if flight.end_sent_at_s is None and broken:
            self._add(relabel_failure(rule, broken))
            return
        ends = find_ending_failures(flight, self.limits)
        if rule == "stream-end":
            ends.pop("exit-code", None)  # how it calls a run that has vanished is its own affair
        self._add(relabel_failure(rule, ends))

    def _leave_unjudged(self, first: Transcript, found: dict[str, Failure]) -> None:
        reason = f"first put right: {', '.join(rule for rule in found if rule in STOPPING_RULES)}"
        self.unjudged |= dict.fromkeys(_LATER_RULES, reason)
        if first.end_sent_at_s is None or "listens-first" in found:  # it may have missed Ending, too
            self.unjudged |= dict.fromkeys(("ending", "exit-code"), reason)
        if {"joins", "listens-first"} & found.keys():
            self.unjudged |= dict.fromkeys(_SESSION_RULES, reason)
        elif not first.commands():
            judged_by_commands = ("contract", "integers", "tick", "finite", "byte-order", "schema", "once", "deadline")
            self.unjudged |= dict.fromkeys(judged_by_commands, reason)
        if "ending" in found:
            self.unjudged["exit-code"] = reason

    def _note_pace(self, first: Transcript) -> None:
        slowest_s = get_slowest_answer_s(first)
        if slowest_s is not None:
            self.notes["deadline"] = f"slowest {1e3 * slowest_s:.1f} ms of {self.limits.answer_s:g} s"
        if first.joined_at_s is not None:
            self.notes["joins"] = f"after {first.joined_at_s:.1f} s"

    # Who joins by being started has said nothing yet when the run ends at once: it may still be starting.
    def _play(self, name: str, variation: Variation, seed: int = SEED, start_s: float = 0.0) -> Transcript:
        self.report_progress(name)
        time.sleep(max(0.0, self._started_at + MIN_START_INTERVAL_S - time.monotonic()))
        self._started_at = time.monotonic()
        script = SessionScript(name=name, seed=seed, variation=variation, start_s=start_s)
        played = ScriptedSession(open_transport(self.connection), script, self.limits, self.connection.needs()).play()
        if played.joins_by_start and played.arrivals:
            self._start_s = max(self._start_s, played.arrivals[0].at_s)
        return played

    def _add(self, *found: dict[str, Failure]) -> None:
        for failures in found:
            for rule, failure in failures.items():
                self.failures.setdefault(rule, failure)
