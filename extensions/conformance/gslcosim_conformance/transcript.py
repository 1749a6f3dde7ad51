"""Sessions of a check: their scripts and time limits, and what transcripts of agents and participants have alike."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from gslcosim.scenario.models.scenario import AgentSpec
from gslcosim_conformance.rules import Failure, Variation


@dataclass(frozen=True, kw_only=True)
class SessionLimits:
    """Time limits of a check [s]: for a program to join, to answer, to exit, and for what it may still send."""

    join_s: float = 30.0
    answer_s: float = AgentSpec.model_fields["answer_within_s"].default
    exit_s: float = 2.0
    settle_s: float = 0.3


@dataclass(frozen=True, kw_only=True)
class SessionScript:
    """Script of a session: its name, its seed, and what is special.

    `start_s` is how long the program may need to start, where it does not show that it has [s].
    """

    name: str
    seed: int
    variation: Variation = "plain"
    start_s: float = 0.0

    def exit_within_s(self, limits: SessionLimits) -> float:
        """Return how long after it was sent the end the program has to exit [s]."""
        return limits.exit_s + self.start_s


@dataclass
class Transcript(ABC):
    """Transcript of one session; times are seconds since its start, None where something did not happen."""

    script: SessionScript
    end_sent_at_s: float | None = None
    exit_code: int | None = None
    log_tail: str = ""
    leftover_processes: tuple[str, ...] = ()

    @property
    @abstractmethod
    def title(self) -> str:
        """The session in words."""

    @abstractmethod
    def answers(self) -> Mapping[int, object]:
        """Return the valid answers by tick, without what makes no difference to a run."""

    @abstractmethod
    def describe_question(self, tick: int) -> str:
        """Return what was sent at a tick that wants an answer, in words."""

    @abstractmethod
    def format_answer(self, tick: int) -> str:
        """Return what was answered at a tick, in words."""

    def build_failure(self, rule: str, *, sent: str, expected: str, got: str, remedy: str = "") -> Failure:
        """Return a break of a rule in this session."""
        return Failure(rule=rule, flight=self.script.name, sent=sent, expected=expected, got=got, remedy=remedy)

    def append_log_tail(self, text: str) -> str:
        """Return a text with the end of the program's log behind it."""
        return f"{text}\nThe end of its log: {self.log_tail}" if self.log_tail else text
