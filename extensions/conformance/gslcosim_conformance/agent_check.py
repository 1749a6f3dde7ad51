"""Check of an agent: the rules that transcripts of its sessions break."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from typing_extensions import override

from gslcosim.base.processes import describe_exit
from gslcosim_conformance.check import Check, find_difference, relabel_failure
from gslcosim_conformance.rules import RULES, CheckReport, Failure, Rule
from gslcosim_conformance.session import (
    BELIEF_PERIOD_TICKS,
    MAX_SURPLUS_MESSAGES,
    AgentTranscript,
    Question,
    ReceivedAnswer,
    ScriptedSession,
)
from gslcosim_conformance.transcript import SessionLimits, SessionScript
from gslcosim_conformance.transports import ConnectionSpec, open_transport


def find_session_failures(transcript: AgentTranscript, limits: SessionLimits) -> dict[str, Failure]:
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


def find_ending_failures(transcript: AgentTranscript, limits: SessionLimits) -> dict[str, Failure]:
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
        got = transcript.append_log_tail(describe_exit(transcript.exit_code))
        return _build_failures(transcript, "exit-code", sent=sent, expected="exit code 0", got=got)
    return {}


def find_repeat_failures(transcript: AgentTranscript, *, may_answer_more: bool) -> dict[str, Failure]:
    """Return where an observation that came again was not answered again, or not with the same bytes.

    `may_answer_more` says that it is known already that the agent answers more than once.
    """
    for question in transcript.questions:
        answers = [arrival.answer for arrival in transcript.answers_to(question)]
        if question.n_sent == 1 or not answers:
            continue
        sent = f"{transcript.describe_question(question.tick)} again, after its answer and another briefing"
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


def get_slowest_answer_s(transcript: AgentTranscript) -> float | None:
    """Return the longest time from a question to its answer [s]."""
    answered = [question for question in transcript.questions if transcript.answers_to(question)]
    return max((transcript.answers_to(q)[0].at_s - q.sent_at_s for q in answered), default=None)


def _iter_failures(transcript: AgentTranscript, limits: SessionLimits) -> Iterator[Failure]:
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
def _find_early_death(transcript: AgentTranscript) -> bool:
    is_over = transcript.exited_at_s is not None and transcript.end_sent_at_s is None
    is_first = transcript.joins_by_start and transcript.script.variation == "plain"
    is_mute = not transcript.n_arrivals and len(transcript.questions) <= 1
    return is_first and is_over and is_mute


def _find_absence(transcript: AgentTranscript, limits: SessionLimits) -> Failure:
    got = f"nothing for {limits.join_s:g} s"
    if transcript.exited_at_s is not None:
        got = f"the process {describe_exit(transcript.exit_code or 0)} after {transcript.exited_at_s:.1f} s"
    if transcript.unexpected_messages:
        got += f"; but {transcript.unexpected_messages[0]}"
    expected = f"an agent that has joined within {limits.join_s:g} s, and lives"
    got = transcript.append_log_tail(got)
    return _build_failure(transcript, "joins", sent="its environment", expected=expected, got=got)


def _find_question_failures(
    transcript: AgentTranscript, question: Question, limits: SessionLimits
) -> Iterator[Failure]:
    sent = transcript.describe_question(question.tick)
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
def _find_unasked_failures(transcript: AgentTranscript) -> Iterator[Failure]:
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
def _find_belief_failures(transcript: AgentTranscript) -> Iterator[Failure]:
    last: int | None = None
    for tick, command in sorted(transcript.commands().items()):
        if command.belief is None:
            continue
        if last is not None and tick - last < BELIEF_PERIOD_TICKS:
            got = f"beliefs at ticks {last} and {tick}"
            expected = f"beliefs at least {BELIEF_PERIOD_TICKS} ticks apart"
            yield _build_failure(
                transcript, "beliefs", sent=transcript.describe_question(tick), expected=expected, got=got
            )
        last = tick


def _find_access_failures(transcript: AgentTranscript) -> Iterator[Failure]:
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


def _find_early_leave(transcript: AgentTranscript) -> Iterator[Failure]:
    if not _has_left_early(transcript) or transcript.is_abandoned:
        return
    how = transcript.left_how
    if transcript.exited_at_s is not None:
        how = f"the process {describe_exit(transcript.exit_code or 0)}"
    last = max(transcript.sent_ticks, default=None)
    sent = "the briefing" if last is None else f"observations up to tick {last}, and no Ending"
    got = transcript.append_log_tail(f"{how} before the end of the run")
    yield _build_failure(transcript, "stays", sent=sent, expected="an agent that stays", got=got)


def _has_left_early(transcript: AgentTranscript) -> bool:
    times = [at for at in (transcript.exited_at_s, transcript.left_at_s) if at is not None]
    end_s = transcript.end_sent_at_s
    return bool(times) and (end_s is None or min(times) < end_s)


def _build_failures(
    transcript: AgentTranscript, rule: str, *, sent: str, expected: str, got: str
) -> dict[str, Failure]:
    return {rule: _build_failure(transcript, rule, sent=sent, expected=expected, got=got)}


def _build_failure(
    transcript: AgentTranscript, rule: str, *, sent: str, expected: str, got: str, remedy: str = ""
) -> Failure:
    sent = sent or "the briefing and observations"
    return transcript.build_failure(rule, sent=sent, expected=expected, got=got, remedy=remedy)


def _append_fault(got: str, arrival: ReceivedAnswer) -> str:
    return f"{got}\nA run would say: {arrival.fault}" if arrival.fault and arrival.fault not in got else got


def check_agent(
    connection: ConnectionSpec,
    limits: SessionLimits | None = None,
    report_progress: Callable[[str], None] = lambda _: None,
) -> CheckReport:
    """Return the report of a check of an agent.

    Args:
        report_progress: Gets the name of each run before it begins.
    """
    return AgentCheck(connection, limits or SessionLimits(), report_progress).run()


@dataclass
class AgentCheck(Check[AgentTranscript]):
    """One agent under check."""

    rules = RULES
    random_note = "answered rightly; whether as before cannot be told while determinism fails"

    @override
    def play_script(self, script: SessionScript) -> AgentTranscript:
        played = ScriptedSession(open_transport(self.connection), script, self.limits, self.connection.needs()).play()
        if played.joins_by_start and played.arrivals:
            self.start_s = max(self.start_s, played.arrivals[0].at_s)
        return played

    @override
    def find_session_failures(self, transcript: AgentTranscript) -> dict[str, Failure]:
        return find_session_failures(transcript, self.limits)

    @override
    def find_ending_failures(self, transcript: AgentTranscript, rule: str | None = None) -> dict[str, Failure]:
        ends = find_ending_failures(transcript, self.limits)
        if rule is None:
            return ends
        if transcript.script.variation == "lost link":
            ends.pop("exit-code", None)  # how it calls a run that has vanished is its own affair
        return relabel_failure(rule, ends)

    @override
    def find_variation_failures(self, rule: Rule, transcript: AgentTranscript) -> dict[str, Failure]:
        if rule.variation != "repeats":
            return {}
        return find_repeat_failures(transcript, may_answer_more="once" in self.failures)

    @override
    def note_pace(self, first: AgentTranscript) -> None:
        slowest_s = get_slowest_answer_s(first)
        if slowest_s is not None:
            self.notes["deadline"] = f"slowest {1e3 * slowest_s:.1f} ms of {self.limits.answer_s:g} s"
        if first.joined_at_s is not None:
            self.notes["joins"] = f"after {first.joined_at_s:.1f} s"

    @override
    def remark_on_other_seed(self, first: AgentTranscript, other: AgentTranscript) -> None:
        is_same = not find_difference("", first, other, sent="")
        self.remarks.append(
            f"With another seed it sends {'the same' if is_same else 'other'} commands; both is allowed."
        )
