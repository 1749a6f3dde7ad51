"""Check of a participant: how its sessions are played, and what their transcripts say of the rules."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from typing_extensions import override

from gslcosim.base.processes import describe_exit
from gslcosim.contract.messages import ParameterValue
from gslcosim_conformance.check import Check
from gslcosim_conformance.participant_session import ParticipantSession, ParticipantTranscript
from gslcosim_conformance.rules import PARTICIPANT_RULES, CheckReport, Failure
from gslcosim_conformance.transcript import SessionLimits, SessionScript
from gslcosim_conformance.transports import ConnectionSpec


def check_participant(
    connection: ConnectionSpec,
    limits: SessionLimits | None = None,
    parameters: Mapping[str, ParameterValue] = MappingProxyType({}),
    report_progress: Callable[[str], None] = lambda _: None,
) -> CheckReport:
    """Return the report of a check of a participant.

    Args:
        report_progress: Gets the name of each session before it begins.
    """
    return ParticipantCheck(connection, limits or SessionLimits(), report_progress, parameters=parameters).run()


@dataclass
class ParticipantCheck(Check[ParticipantTranscript]):
    """One participant under check; `parameters` are what its briefing hands to it."""

    rules = PARTICIPANT_RULES

    parameters: Mapping[str, ParameterValue] = field(default_factory=dict[str, ParameterValue])

    @override
    def play_script(self, script: SessionScript) -> ParticipantTranscript:
        played = ParticipantSession(self.connection, script, self.limits, self.parameters).play()
        if left := ", ".join(played.leftover_processes):
            failure = played.build_failure("leaves-nothing", sent="Ending", expected="no process left", got=left)
            self.failures.setdefault(failure.rule, failure)
        return played

    @override
    def find_session_failures(self, transcript: ParticipantTranscript) -> dict[str, Failure]:
        failure = transcript.failure
        return {} if failure is None else {failure.rule: failure}

    @override
    def find_ending_failures(self, transcript: ParticipantTranscript, rule: str | None = None) -> dict[str, Failure]:
        if transcript.end_sent_at_s is None:
            return {}
        is_lost, code = transcript.script.variation == "lost link", transcript.exit_code
        if code is None:
            rule, expected, got = rule or "ending", f"an exit within {self.limits.exit_s:g} s", "it still runs"
        elif code and not is_lost:
            rule, expected, got = rule or "exit-code", "exit code 0", f"the process {describe_exit(code)}"
        else:
            return {}
        sent = "the end of its stream" if is_lost else "Ending"
        return {rule: transcript.build_failure(rule, sent=sent, expected=expected, got=got)}

    @override
    def note_pace(self, first: ParticipantTranscript) -> None:
        self.notes["hello"] = f"after {first.hello_at_s or 0.0:.1f} s"
        self.notes["answers"] = f"slowest {1e3 * first.slowest_s:.1f} ms of {self.limits.answer_s:g} s"

    @override
    def remark_on_first(self, first: ParticipantTranscript) -> None:
        if first.hello is not None:
            reads, writes = (", ".join(words) or "nothing" for words in (first.hello.reads, first.hello.writes))
            self.remarks.append(f"It reads {reads} and writes {writes}.")


__all__ = ["PARTICIPANT_RULES", "check_participant"]
