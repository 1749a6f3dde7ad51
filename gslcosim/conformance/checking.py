"""A whole check: flights one after the other, and what they say about the rules."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from gslcosim.conformance.findings import CheckReport, Failure, findings_of
from gslcosim.conformance.flight import Flight, FlightLimits, Script, Transcript, Variation
from gslcosim.conformance.judging import (
    GROUNDS_FOR_STOPPING,
    difference,
    ending_failures,
    flight_failures,
    renamed,
    repeat_failures,
    slowest_answer_s,
)
from gslcosim.conformance.orphans import Orphans
from gslcosim.conformance.rules import RULES
from gslcosim.conformance.wires import open_wire
from gslcosim.conformance.wiring import Wiring

SEED, OTHER_SEED = 20_230_117, 7
# So that an agent that seeds with the clock's seconds does not look right.
MIN_S_BETWEEN_STARTS = 1.1
# A start may take so many times as long as the slowest one before.
START_FACTOR = 2.0
_VARIATIONS: dict[str, tuple[Variation, str]] = {
    "unknown-fields": ("unknown fields", ", with fields of a later minor version such as x_text and x_list"),
    "optional-fields": ("optional fields", ", without the fields that have a default"),
    "repeats": ("repeats", ", some of them sent again after the answer"),
}
_AFTER_FIRST = ("restart", "determinism", *_VARIATIONS, "early-ending", "stream-end")
_IN_FLIGHT = tuple(rule for rule in RULES if rule not in (*_AFTER_FIRST, "joins", "ending", "exit-code"))


def check_agent(
    wiring: Wiring, limits: FlightLimits | None = None, report_progress: Callable[[str], None] = lambda _: None
) -> CheckReport:
    """Return what a check finds out about an agent.

    Args:
        wiring: How it is started and spoken to.
        limits: How long it is waited for.
        report_progress: Gets the name of each flight before it begins.

    Raises:
        UsageError: there is no such program.
    """
    wiring.check()
    return Check(wiring, limits or FlightLimits(), report_progress).run()


@dataclass
class Check:
    """One agent under check: what was played with it, and the rules it has broken so far."""

    wiring: Wiring
    limits: FlightLimits
    report_progress: Callable[[str], None]
    failures: dict[str, Failure] = field(default_factory=dict[str, Failure])
    unjudged: dict[str, str] = field(default_factory=dict[str, str])
    notes: dict[str, str] = field(default_factory=dict[str, str])
    remarks: list[str] = field(default_factory=list[str])
    _started_at: float = 0.0
    _start_s: float = 0.0

    def run(self) -> CheckReport:
        """Play all flights that still can say something; return the report."""
        first = self._play("first", "plain")
        found = flight_failures(first, self.limits)
        self._add(found, {} if "listens-first" in found else ending_failures(first, self.limits))
        if GROUNDS_FOR_STOPPING & found.keys():
            self._leave_unjudged(first, found)
        else:
            self._note_pace(first)
            self._repeat_all(first)
        beyond = {} if Orphans.is_possible() else {"leaves-nothing": "this system does not tell"}
        findings = findings_of(self.wiring.door, self.failures, self.unjudged, self.notes, beyond)
        return CheckReport(
            command=self.wiring.command,
            door=self.wiring.door,
            format=self.wiring.format,
            findings=findings,
            notes=tuple(self.remarks),
        )

    def _repeat_all(self, first: Transcript) -> None:
        second = self._play("again", "plain")
        broken = flight_failures(second, self.limits)
        if GROUNDS_FOR_STOPPING & broken.keys():
            self._add(renamed("restart", broken))
            for rule in _AFTER_FIRST[1:]:
                self.unjudged[rule] = "needs a second start"
            return
        self._add(difference("determinism", first, second, sent=", as before"))
        for rule, (variation, sent) in _VARIATIONS.items():
            if rule != "repeats" or self.wiring.door == "zenoh":
                self._vary(rule, variation, sent, first)
        self._end_otherwise(first)

    # Whoever draws at random cannot be compared with itself; it must still answer rightly.
    def _vary(self, rule: str, variation: Variation, sent: str, first: Transcript) -> None:
        flight = self._play(variation, variation)
        broken = flight_failures(flight, self.limits)
        if GROUNDS_FOR_STOPPING & broken.keys():
            self._add(renamed(rule, broken))
            return
        if rule == "repeats":
            self._add(repeat_failures(flight, may_answer_more="once" in self.failures))
        if "determinism" in self.failures:
            self.notes[rule] = "answered rightly; whether as before cannot be told while determinism fails"
        else:
            self._add(difference(rule, first, flight, sent=sent))

    def _end_otherwise(self, first: Transcript) -> None:
        if {"ending", "exit-code"} & self.failures.keys():
            self.unjudged["early-ending"] = "first let it end rightly after a flight"
        else:
            early = self._play("ending at once", "ending at once", start_s=START_FACTOR * self._start_s)
            self._judge_end("early-ending", early)
        lost = self._play("lost link", "lost link", seed=OTHER_SEED)
        self._judge_end("stream-end", lost)
        is_same = not difference("", first, lost, sent="")
        self.remarks.append(
            f"With another seed it sends {'the same' if is_same else 'other'} commands; both is allowed."
        )

    def _judge_end(self, rule: str, flight: Transcript) -> None:
        broken = flight_failures(flight, self.limits)
        if flight.end_told_at_s is None and broken:
            self._add(renamed(rule, broken))
            return
        ends = ending_failures(flight, self.limits)
        if rule == "stream-end":
            ends.pop("exit-code", None)  # how it calls a run that has vanished is its own affair
        self._add(renamed(rule, ends))

    def _leave_unjudged(self, first: Transcript, found: dict[str, Failure]) -> None:
        reason = f"first put right: {', '.join(rule for rule in found if rule in GROUNDS_FOR_STOPPING)}"
        self.unjudged |= dict.fromkeys(_AFTER_FIRST, reason)
        if first.end_told_at_s is None or "listens-first" in found:  # it may have missed Ending, too
            self.unjudged |= dict.fromkeys(("ending", "exit-code"), reason)
        if {"joins", "listens-first"} & found.keys():
            self.unjudged |= dict.fromkeys(_IN_FLIGHT, reason)
        elif not first.commands():
            judged_by_commands = ("contract", "integers", "tick", "finite", "byte-order", "schema", "once", "deadline")
            self.unjudged |= dict.fromkeys(judged_by_commands, reason)
        if "ending" in found:
            self.unjudged["exit-code"] = reason

    def _note_pace(self, first: Transcript) -> None:
        slowest_s = slowest_answer_s(first)
        if slowest_s is not None:
            self.notes["deadline"] = f"slowest {1e3 * slowest_s:.1f} ms of {self.limits.answer_s:g} s"
        if first.joined_at_s is not None:
            self.notes["joins"] = f"after {first.joined_at_s:.1f} s"

    # Who joins by being started has said nothing yet when the run ends at once: it may still be starting.
    def _play(self, name: str, variation: Variation, seed: int = SEED, start_s: float = 0.0) -> Transcript:
        self.report_progress(name)
        time.sleep(max(0.0, self._started_at + MIN_S_BETWEEN_STARTS - time.monotonic()))
        self._started_at = time.monotonic()
        script = Script(name=name, seed=seed, variation=variation, start_s=start_s)
        played = Flight(open_wire(self.wiring), script, self.limits, self.wiring.needs()).play()
        if played.joins_by_start and played.arrivals:
            self._start_s = max(self._start_s, played.arrivals[0].at_s)
        return played

    def _add(self, *found: dict[str, Failure]) -> None:
        for failures in found:
            for rule, failure in failures.items():
                self.failures.setdefault(rule, failure)
