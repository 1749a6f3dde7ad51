"""Engine of a check: sessions with a program one after the other, and the rules of a table that it breaks in them."""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Generic, TypeVar

from gslcosim_conformance.rules import CheckReport, Failure, Rule, Variation, build_findings
from gslcosim_conformance.transcript import SessionLimits, SessionScript, Transcript
from gslcosim_conformance.transports import ConnectionSpec, OrphanProcesses

SEED, OTHER_SEED = 20_230_117, 7
# So that a program that draws by the clock's seconds does not look right.
MIN_START_INTERVAL_S = 1.1
# A start may take so many times as long as the slowest one before.
START_FACTOR = 2.0

TranscriptT = TypeVar("TranscriptT", bound=Transcript)


def relabel_failure(rule: str, failures: Mapping[str, Failure]) -> dict[str, Failure]:
    """Return the first of some failures as the break of another rule."""
    first = next(iter(failures.values()), None)
    return {} if first is None else {rule: replace(first, rule=rule, got=f"{first.got} ({first.rule})")}


def find_difference(rule: str, first: Transcript, second: Transcript, *, sent: str) -> dict[str, Failure]:
    """Return where the answers of two sessions begin to differ, as the break of a rule."""
    before, after = first.answers(), second.answers()
    for tick in sorted({*before, *after}):
        if before.get(tick) != after.get(tick):
            expected = f"{first.format_answer(tick)}, as in {first.title}"
            sent, got = f"{second.describe_question(tick)}{sent}", second.format_answer(tick)
            return {rule: second.build_failure(rule, sent=sent, expected=expected, got=got)}
    return {}


@dataclass
class Check(ABC, Generic[TranscriptT]):
    """One program under check: the rules that it has broken so far, and what else was seen.

    Those of agents and of participants say how a session is played and which rules its transcript breaks; the table of
    rules says which sessions there are, and what a break means for the rest of the check.
    """

    rules: ClassVar[Mapping[str, Rule]]
    # What is said of a rule's session where a program that draws at random cannot be compared with itself.
    random_note: ClassVar[str] = ""

    connection: ConnectionSpec
    limits: SessionLimits
    report_progress: Callable[[str], None]
    failures: dict[str, Failure] = field(default_factory=dict[str, Failure])
    unjudged: dict[str, str] = field(default_factory=dict[str, str])
    notes: dict[str, str] = field(default_factory=dict[str, str])
    remarks: list[str] = field(default_factory=list[str])
    # The slowest start of a program that does not show that it has started [s].
    start_s: float = 0.0
    _started_at_s: float = 0.0

    @abstractmethod
    def play_script(self, script: SessionScript) -> TranscriptT:
        """Return what happened in a session with one start of the program."""

    @abstractmethod
    def find_session_failures(self, transcript: TranscriptT) -> dict[str, Failure]:
        """Return the rules broken in a session; how the program ends is not part of it."""

    @abstractmethod
    def find_ending_failures(self, transcript: TranscriptT, rule: str | None = None) -> dict[str, Failure]:
        """Return the rules broken after the program was sent the end: `ending` or `exit-code`, or the given one."""

    @abstractmethod
    def note_pace(self, first: TranscriptT) -> None:
        """Note how fast the program was in a first session that goes on."""

    def find_variation_failures(self, rule: Rule, transcript: TranscriptT) -> dict[str, Failure]:
        """Return how a rule is broken in its own session, beside other answers than in the first."""
        del rule, transcript
        return {}

    def remark_on_first(self, first: TranscriptT) -> None:
        """Remark on the program after its first session."""

    def remark_on_other_seed(self, first: TranscriptT, other: TranscriptT) -> None:
        """Remark on the program after a session with another seed."""

    def run(self) -> CheckReport:
        """Play all sessions that still can say something; return the report."""
        self.connection.check()
        first = self._play("first")
        self.remark_on_first(first)
        found = self.find_session_failures(first)
        opening = next((rule for rule in found if self.rules[rule].stage == "opening"), None)
        ends = {} if opening else self.find_ending_failures(first)
        self._add(found, ends)
        for rule in self.rules.values():
            if rule.stage == "end" and (broken := [each for each in rule.after if each in ends]):
                self.unjudged[rule.id] = f"first put right: {', '.join(broken)}"
        if self._stops(found):
            self._leave_unjudged(first, found, opening)
        else:
            self.note_pace(first)
            self._play_again(first)
        beyond = {} if OrphanProcesses.is_possible() else {"leaves-nothing": "this system does not tell"}
        return CheckReport(
            command=self.connection.command,
            transport=self.connection.transport,
            format=self.connection.format,
            findings=build_findings(
                self.connection.transport, self.failures, self.unjudged, self.notes, beyond, rules=self.rules
            ),
            notes=tuple(self.remarks),
        )

    def _play_again(self, first: TranscriptT) -> None:
        second = self._play("again")
        broken = self.find_session_failures(second)
        if self._stops(broken):
            self._add(relabel_failure("restart", broken))
            later = (rule.id for rule in self.rules.values() if rule.stage == "later" and rule.id != "restart")
            self.unjudged |= dict.fromkeys(later, "needs a second start")
            return
        self._add(find_difference("determinism", first, second, sent=self.rules["determinism"].change or ""))
        for rule in self.rules.values():
            if rule.variation == "plain" or not rule.applies_to(self.connection.transport):
                continue
            if self.failures.keys() & {*rule.after}:
                self.unjudged[rule.id] = "first let it end rightly after a flight"
            elif rule.variation in ("ending at once", "lost link"):
                self._end_otherwise(rule, first)
            else:
                self._vary(rule, first)

    # Whoever draws at random cannot be compared with itself; it must still answer rightly.
    def _vary(self, rule: Rule, first: TranscriptT) -> None:
        varied = self._play(rule.variation, rule.variation)
        broken = self.find_session_failures(varied)
        if self._stops(broken):
            self._add(relabel_failure(rule.id, broken))
            return
        self._add(self.find_variation_failures(rule, varied))
        if "determinism" in self.failures:
            self.notes[rule.id] = self.random_note
        elif rule.change is not None:
            self._add(find_difference(rule.id, first, varied, sent=rule.change))

    # Who joins by being started has said nothing yet when the run ends at once: it may still be starting.
    def _end_otherwise(self, rule: Rule, first: TranscriptT) -> None:
        is_lost = rule.variation == "lost link"
        seed, start_s = (OTHER_SEED, 0.0) if is_lost else (SEED, START_FACTOR * self.start_s)
        ended = self._play(rule.variation, rule.variation, seed=seed, start_s=start_s)
        broken = self.find_session_failures(ended)
        if ended.end_sent_at_s is None and broken:
            self._add(relabel_failure(rule.id, broken))
        else:
            self._add(self.find_ending_failures(ended, rule.id))
        if is_lost:
            self.remark_on_other_seed(first, ended)

    def _leave_unjudged(self, first: TranscriptT, found: Mapping[str, Failure], opening: str | None) -> None:
        is_behind = False
        for rule in self.rules.values():
            if (
                rule.stage == "later"
                or (rule.stage == "end" and (first.end_sent_at_s is None or opening))  # it may have missed Ending, too
                or (rule.stage in ("opening", "session") and is_behind)
                or (rule.needs_answers and not first.answers())
            ):
                self.unjudged[rule.id] = f"first put right: {', '.join(self._stops(found))}"
            is_behind = is_behind or rule.id == opening

    def _stops(self, found: Mapping[str, Failure]) -> list[str]:
        return [rule for rule in found if self.rules[rule].stops]

    def _play(
        self, name: str, variation: Variation = "plain", *, seed: int = SEED, start_s: float = 0.0
    ) -> TranscriptT:
        self.report_progress(name)
        time.sleep(max(0.0, self._started_at_s + MIN_START_INTERVAL_S - time.monotonic()))
        self._started_at_s = time.monotonic()
        return self.play_script(SessionScript(name=name, seed=seed, variation=variation, start_s=start_s))

    def _add(self, *found: Mapping[str, Failure]) -> None:
        for failures in found:
            for rule, failure in failures.items():
                self.failures.setdefault(rule, failure)
