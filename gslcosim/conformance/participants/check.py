"""Check of a participant: sessions one after the other, and the rules that they break."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from gslcosim.base.command_lines import describe_exit
from gslcosim.conformance.participants.session import ParticipantSession, SessionKind, SessionResult, SessionScript
from gslcosim.conformance.report import CheckReport, Failure, build_findings
from gslcosim.conformance.rules import PARTICIPANT_RULES
from gslcosim.conformance.session import SessionLimits
from gslcosim.conformance.transports import ConnectionSpec, OrphanProcesses
from gslcosim.contract.messages import ParameterValue

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
