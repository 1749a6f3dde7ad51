"""From what happened in flights to broken rules: pure functions over transcripts."""

from collections.abc import Iterator

from gslcosim.command_lines import exit_text
from gslcosim.conformance.answers import shown_command
from gslcosim.conformance.findings import Failure
from gslcosim.conformance.flight import BELIEF_EVERY_TICKS, FLOOD_MESSAGES, Arrival, FlightLimits, Question, Transcript
from gslcosim.contract.messages import Command

# After one of these the rest of a check would only repeat it in other words.
GROUNDS_FOR_STOPPING = frozenset(
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


def flight_failures(transcript: Transcript, limits: FlightLimits) -> dict[str, Failure]:
    """Return the rules broken in one flight, each with its first break; how the agent ends is not part of it."""
    found: dict[str, Failure] = {}
    for failure in _in_order(transcript, limits):
        found.setdefault(failure.rule, failure)
    if transcript.left_over:
        got = f"{', '.join(transcript.left_over)}, which the check has ended"
        found |= _one(transcript, "leaves-nothing", sent="", expected="no process of it after its end", got=got)
    return found


def ending_failures(transcript: Transcript, limits: FlightLimits) -> dict[str, Failure]:
    """Return the rules broken after the agent was told the end: `ending` or `exit-code`."""
    if transcript.end_told_at_s is None:
        return {}
    sent = "Ending" if transcript.script.variation != "lost link" else "nothing; the link was cut"
    if transcript.exited_at_s is None:
        limit_s, start_s = transcript.script.exit_within_s(limits), transcript.script.start_s
        starting = f" ({start_s:.1f} s of them to start, as before)" if start_s else ""
        expected, got = f"an exit within {limit_s:.3g} s{starting}", f"it still runs {limit_s:.3g} s later"
        return _one(transcript, "ending", sent=sent, expected=expected, got=f"{got}, and was ended by force")
    if transcript.exit_code:
        got = exit_text(transcript.exit_code) + _words(transcript)
        return _one(transcript, "exit-code", sent=sent, expected="exit code 0", got=got)
    return {}


def renamed(rule: str, failures: dict[str, Failure]) -> dict[str, Failure]:
    """Return the first of some failures as the break of another rule."""
    first = next(iter(failures.values()), None)
    return {} if first is None else {rule: _as(rule, first)}


def difference(rule: str, first: Transcript, second: Transcript, *, sent: str) -> dict[str, Failure]:
    """Return where the commands of two flights begin to differ, as the break of a rule."""
    before, after = first.commands(), second.commands()
    for tick in sorted({*before, *after}):
        if not are_alike(before.get(tick), after.get(tick)):
            return _one(
                second,
                rule,
                sent=f"{_observation(tick)}{sent}",
                expected=f"{_shown(before.get(tick))}, as in the flight '{first.script.name}'",
                got=_shown(after.get(tick)),
            )
    return {}


def repeat_failures(transcript: Transcript, *, may_answer_more: bool) -> dict[str, Failure]:
    """Return where an observation that came again was not answered again, or not with the same bytes.

    `may_answer_more` says that it is known already that the agent answers more than once.
    """
    for question in transcript.questions:
        answers = [arrival.answer for arrival in transcript.answers_to(question)]
        if question.n_sent == 1 or not answers:
            continue
        sent = f"{_observation(question.tick)} again, after its answer and another briefing"
        expected = f"the same bytes as before: {answers[0].shown}"
        if len(answers) < question.n_sent:
            return _one(transcript, "repeats", sent=sent, expected=expected, got="nothing")
        if len(answers) > question.n_sent and not may_answer_more:
            got = f"{len(answers)} answers to {question.n_sent} observations"
            return _one(transcript, "repeats", sent=sent, expected=expected, got=got)
        if any(answer.payload != answers[0].payload for answer in answers):
            got = f"{answers[-1].shown} ({len(answers[-1].payload)} bytes, not the same)"
            return _one(transcript, "repeats", sent=sent, expected=expected, got=got)
    return {}


def are_alike(first: Command | None, second: Command | None) -> bool:
    """Return whether two commands are the same to a run: what one says of its contract does not count."""
    if first is None or second is None:
        return first is second
    return first.model_copy(update={"contract": None}) == second.model_copy(update={"contract": None})


def slowest_answer_s(transcript: Transcript) -> float | None:
    """Return the longest time from a question to its answer [s]."""
    answered = [question for question in transcript.questions if transcript.answers_to(question)]
    return max((transcript.answers_to(q)[0].at_s - q.sent_at_s for q in answered), default=None)


def _in_order(transcript: Transcript, limits: FlightLimits) -> Iterator[Failure]:
    if transcript.joined_at_s is None or _died_unheard(transcript):
        yield _absence(transcript, limits)
        return
    if transcript.unheard:
        expected = f"subscriptions to {', '.join(transcript.unheard)} before the token"
        yield _failure(transcript, "listens-first", sent="", expected=expected, got="a token without them")
        return
    if transcript.n_surplus > FLOOD_MESSAGES:
        n_asked = sum(question.n_sent for question in transcript.questions)
        expected = f"{n_asked} commands, one for each observation that awaited one"
        yield _failure(
            transcript,
            "flood",
            sent=f"{n_asked} observations that await a command",
            expected=expected,
            got=f"{transcript.n_arrivals} messages, and then the check gave up",
        )
    else:
        for question in transcript.questions:
            yield from _question_failures(transcript, question, limits)
        yield from _unasked_failures(transcript)
        yield from _belief_failures(transcript)
    yield from _trespasses(transcript)
    yield from _early_leave(transcript)


# Over stdio an agent has joined as soon as it is started. One that is gone without a word has never really come.
def _died_unheard(transcript: Transcript) -> bool:
    is_over = transcript.exited_at_s is not None and transcript.end_told_at_s is None
    is_first = transcript.joins_by_start and transcript.script.variation == "plain"
    is_mute = not transcript.n_arrivals and len(transcript.questions) <= 1
    return is_first and is_over and is_mute


def _absence(transcript: Transcript, limits: FlightLimits) -> Failure:
    got = f"nothing for {limits.join_s:g} s"
    if transcript.exited_at_s is not None:
        got = f"the process {exit_text(transcript.exit_code or 0)} after {transcript.exited_at_s:.1f} s"
    if transcript.strays:
        got += f"; but {transcript.strays[0]}"
    expected = f"an agent that has joined within {limits.join_s:g} s, and lives"
    return _failure(transcript, "joins", sent="its environment", expected=expected, got=got + _words(transcript))


def _question_failures(transcript: Transcript, question: Question, limits: FlightLimits) -> Iterator[Failure]:
    sent = _observation(question.tick)
    answers = transcript.answers_to(question)
    others = [a for a in transcript.arrivals if a.open_tick == question.tick and a not in answers]
    for arrival in (*answers[:1], *others):
        if problem := arrival.answer.problem:
            got = _with_fault(problem.got, arrival)
            yield _failure(
                transcript, problem.rule, sent=sent, expected=problem.expected, got=got, remedy=problem.remedy
            )
    if answers:
        waited_s = answers[0].at_s - question.sent_at_s
        if waited_s > limits.answer_s:
            expected, got = f"an answer within {limits.answer_s:g} s", f"one after {waited_s:.2f} s"
            yield _failure(transcript, "deadline", sent=sent, expected=expected, got=got)
        if len(answers) > question.n_sent and transcript.script.variation != "repeats":
            got = f"{len(answers)}: {answers[0].answer.shown}; {answers[1].answer.shown}"
            yield _failure(transcript, "once", sent=sent, expected="one command", got=got)
    elif wrong := [arrival for arrival in others if arrival.answer.command]:
        got = _with_fault(wrong[0].answer.shown, wrong[0])
        yield _failure(transcript, "tick", sent=sent, expected=f"a Command with tick {question.tick}", got=got)
    elif not others and not _is_gone_early(transcript):
        got = f"nothing within {2 * limits.answer_s:g} s"
        yield _failure(transcript, "answers", sent=sent, expected=f"a Command with tick {question.tick}", got=got)


# What came while no question was open, and commands for observations that asked for none, beside the right answer.
def _unasked_failures(transcript: Transcript) -> Iterator[Failure]:
    asked = {question.tick for question in transcript.questions}
    answered = {question.tick for question in transcript.questions if transcript.answers_to(question)}
    for arrival in transcript.arrivals:
        answer = arrival.answer
        if arrival.open_tick is None and answer.problem is not None:
            problem, got = answer.problem, _with_fault(answer.problem.got, arrival)
            yield _failure(transcript, problem.rule, sent="", expected=problem.expected, got=got, remedy=problem.remedy)
        elif answer.command is not None and answer.tick not in asked and arrival.open_tick in {None, *answered}:
            sent = (
                "the briefing"
                if not transcript.told_ticks
                else f"Observation, tick {answer.tick}, awaiting_command false"
            )
            sent = sent if answer.tick in transcript.told_ticks else f"no observation of tick {answer.tick}"
            got = _with_fault(answer.shown, arrival)
            yield _failure(transcript, "unasked", sent=sent, expected="no command", got=got)


# The vehicle would fly all the same: the door passes a command without a belief that comes too soon.
def _belief_failures(transcript: Transcript) -> Iterator[Failure]:
    last: int | None = None
    for tick, command in sorted(transcript.commands().items()):
        if command.belief is None:
            continue
        if last is not None and tick - last < BELIEF_EVERY_TICKS:
            got = f"beliefs at ticks {last} and {tick}"
            expected = f"beliefs at least {BELIEF_EVERY_TICKS} ticks apart"
            yield _failure(transcript, "beliefs", sent=_observation(tick), expected=expected, got=got)
        last = tick


def _trespasses(transcript: Transcript) -> Iterator[Failure]:
    if transcript.strays:
        yield _failure(
            transcript,
            "own-key",
            sent="",
            expected="messages on agents/<name>/command and the token agents/<name>/alive only",
            got=f"{', '.join(sorted({*transcript.strays})[:5])}. In a run the router denies it.",
        )
    reached = [f"a subscription that includes {key}" for key in transcript.overheard]
    reached += [f"a query of {key}" for key in sorted({*transcript.queries})]
    if reached:
        yield _failure(
            transcript,
            "own-ears",
            sent="",
            expected="subscriptions to agents/<name>/briefing, observation and ending only",
            got=f"{', '.join(reached[:5])}. In a run the router denies it.",
        )


def _early_leave(transcript: Transcript) -> Iterator[Failure]:
    if not _is_gone_early(transcript) or transcript.is_given_up:
        return
    how = transcript.left_how
    if transcript.exited_at_s is not None:
        how = f"the process {exit_text(transcript.exit_code or 0)}"
    last = max(transcript.told_ticks, default=None)
    sent = "the briefing" if last is None else f"observations up to tick {last}, and no Ending"
    got = f"{how} before the end of the run{_words(transcript)}"
    yield _failure(transcript, "stays", sent=sent, expected="an agent that stays", got=got)


def _is_gone_early(transcript: Transcript) -> bool:
    times = [at for at in (transcript.exited_at_s, transcript.left_at_s) if at is not None]
    end_s = transcript.end_told_at_s
    return bool(times) and (end_s is None or min(times) < end_s)


def _one(transcript: Transcript, rule: str, *, sent: str, expected: str, got: str) -> dict[str, Failure]:
    return {rule: _failure(transcript, rule, sent=sent, expected=expected, got=got)}


def _failure(transcript: Transcript, rule: str, *, sent: str, expected: str, got: str, remedy: str = "") -> Failure:
    sent = sent or "the briefing and observations"
    return Failure(rule=rule, flight=transcript.script.name, sent=sent, expected=expected, got=got, remedy=remedy)


def _as(rule: str, failure: Failure) -> Failure:
    return Failure(
        rule=rule,
        flight=failure.flight,
        sent=failure.sent,
        expected=failure.expected,
        got=f"{failure.got} ({failure.rule})",
        remedy=failure.remedy,
    )


def _observation(tick: int) -> str:
    return f"Observation, tick {tick}, awaiting_command true"


def _shown(command: Command | None) -> str:
    return f"Command {shown_command(command)}" if command else "nothing"


def _with_fault(got: str, arrival: Arrival) -> str:
    return f"{got}\nA run would say: {arrival.fault}" if arrival.fault and arrival.fault not in got else got


def _words(transcript: Transcript) -> str:
    return f"\nThe end of its log: {transcript.last_words}" if transcript.last_words else ""
