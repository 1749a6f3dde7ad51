"""A whole check of a participant: sessions one after the other, and what they say about the rules."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from gslcosim.command_lines import exit_text
from gslcosim.conformance.findings import CheckReport, Failure, findings_of
from gslcosim.conformance.flight import FlightLimits
from gslcosim.conformance.orphans import Orphans
from gslcosim.conformance.participants.participant_rules import PARTICIPANT_RULES
from gslcosim.conformance.participants.session import Kind, ParticipantSession, Played, SessionScript
from gslcosim.conformance.wiring import Wiring
from gslcosim.contract.knowledge import ParameterValue

SEED, OTHER_SEED = 20_230_117, 7
# So that a program that draws by the clock's seconds does not look right.
MIN_S_BETWEEN_STARTS = 1.1
_IN_SESSION = ("hello", "ports", "contract", "answers", "encoding", "tick", "outputs", "values", "once", "stays")
_LATER: dict[str, tuple[Kind, str]] = {
    "unknown-fields": ("unknown fields", ", with fields of a later minor version such as x_text and x_list"),
    "missing-inputs": ("missing inputs", ""),
}


def check_participant(
    wiring: Wiring,
    limits: FlightLimits | None = None,
    parameters: Mapping[str, ParameterValue] = MappingProxyType({}),
    report_progress: Callable[[str], None] = lambda _: None,
) -> CheckReport:
    """Return what a check finds out about a participant.

    Args:
        wiring: How it is started and spoken to.
        limits: How long it is waited for.
        parameters: What its briefing hands to it.
        report_progress: Gets the name of each session before it begins.

    Raises:
        UsageError: there is no such program.
    """
    wiring.check()
    return Examination(wiring, limits or FlightLimits(), parameters, report_progress).run()


@dataclass
class Examination:
    """One participant under check: what was played with it, and the rules that it has broken so far."""

    wiring: Wiring
    limits: FlightLimits
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
        beyond = {} if Orphans.is_possible() else {"leaves-nothing": "this system does not tell"}
        hello = first.hello
        ports = () if hello is None else (f"It reads {_listed(hello.reads)} and writes {_listed(hello.writes)}.",)
        rules = PARTICIPANT_RULES
        return CheckReport(
            command=self.wiring.command,
            door=self.wiring.door,
            format=self.wiring.format,
            findings=findings_of(self.wiring.door, self.failures, self.unjudged, self.notes, beyond, rules=rules),
            notes=ports,
        )

    def _repeat_all(self, first: Played) -> None:
        second = self._play("again", "plain")
        if second.failure is not None:
            self._add(_as("restart", second.failure))
            for rule in ("determinism", *_LATER, "early-ending", "stream-end"):
                self.unjudged[rule] = "needs a second start"
            return
        self._add(_difference("determinism", first, second, sent=", as before"))
        for rule, (kind, sent) in _LATER.items():
            played = self._play(kind, kind)
            if played.failure is not None:
                self._add(_as(rule, played.failure))
            elif rule == "unknown-fields" and "determinism" not in self.failures:
                self._add(_difference(rule, first, played, sent=sent))
        early = self._play("ending at once", "ending at once")
        if early.failure is None:
            self._judge_end(early, "early-ending", "early-ending")
        else:
            self._add(_as("early-ending", early.failure))
        lost = self._play("lost link", "lost link", seed=OTHER_SEED)
        if lost.failure is None:
            self._judge_end(lost, "stream-end", None)
        else:
            self._add(_as("stream-end", lost.failure))

    def _judge_end(self, played: Played, rule: str, rule_of_code: str | None) -> None:
        sent = "the end of its stream" if played.script.kind == "lost link" else "Ending"
        within = f"{self.limits.exit_s:g} s"
        if played.exit_code is None:
            self._add(_failure(rule, played, sent, f"an exit within {within}", "it still runs"))
            if rule_of_code is not None and rule_of_code != rule:
                self.unjudged[rule_of_code] = f"first put right: {rule}"
        elif rule_of_code is not None and played.exit_code != 0:
            self._add(_failure(rule_of_code, played, sent, "exit code 0", f"the process {exit_text(played.exit_code)}"))

    def _leave_unjudged(self, rule: str) -> None:
        reason = f"first put right: {rule}"
        later = [each for each in PARTICIPANT_RULES if each not in (*_IN_SESSION, "leaves-nothing")]
        passed = _IN_SESSION[: _IN_SESSION.index(rule)] if rule in ("hello", "ports", "contract") else ()
        blocked = _IN_SESSION if rule in ("hello", "ports", "contract") else ()
        for each in (*later, *(name for name in blocked if name not in (*passed, rule))):
            self.unjudged[each] = reason

    def _note_pace(self, first: Played) -> None:
        self.notes["hello"] = f"after {first.hello_at_s:.1f} s"
        self.notes["answers"] = f"slowest {1e3 * first.slowest_s:.1f} ms of {self.limits.answer_s:g} s"

    def _play(self, name: str, kind: Kind, seed: int = SEED) -> Played:
        self.report_progress(name)
        time.sleep(max(0.0, self._started_at_s + MIN_S_BETWEEN_STARTS - time.monotonic()))
        self._started_at_s = time.monotonic()
        script = SessionScript(name=name, seed=seed, kind=kind)
        played = ParticipantSession(self.wiring, script, self.limits, self.parameters).play()
        if played.left_over:
            self._add(_failure("leaves-nothing", played, "Ending", "no process left", ", ".join(played.left_over)))
        return played

    def _add(self, failure: Failure | None) -> None:
        if failure is not None:
            self.failures.setdefault(failure.rule, failure)


def _difference(rule: str, first: Played, later: Played, *, sent: str) -> Failure | None:
    for tick, answers in first.answers.items():
        now = later.answers.get(tick)
        if answers != now:
            shown = [_shown(each) for each in (answers, now or {})]
            told = f"ParticipantInputs, tick {tick}{sent}"
            return _failure(rule, later, told, f"{shown[0]}, as in the first session", shown[1])
    return None


def _shown(answers: Mapping[str, object]) -> str:
    text = ", ".join(f"{word}: {answer}" for word, answer in answers.items())
    return text if len(text) <= 200 else f"{text[:197]}..."


def _failure(rule: str, played: Played, sent: str, expected: str, got: str) -> Failure:
    return Failure(rule=rule, flight=played.script.name, sent=sent, expected=expected, got=got)


def _as(rule: str, failure: Failure) -> Failure:
    return Failure(
        rule=rule,
        flight=failure.flight,
        sent=failure.sent,
        expected=failure.expected,
        got=f"{failure.got} ({failure.rule})",
    )


def _listed(words: tuple[str, ...]) -> str:
    return ", ".join(words) or "nothing"
