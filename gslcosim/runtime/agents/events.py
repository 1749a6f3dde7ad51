"""What an agent's link tells the run: frozen, and in order for each agent."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class AgentJoined:
    """The agent can be spoken to."""

    agent: str


@dataclass(frozen=True, kw_only=True)
class CommandCame:
    """Bytes for the agent's door; `decided_in_s` is what the decision took by the clock, where that is known."""

    agent: str
    payload: bytes
    decided_in_s: float | None = None


@dataclass(frozen=True, kw_only=True)
class CommandRefused:
    """Something came that is no command, and why."""

    agent: str
    text: str


@dataclass(frozen=True, kw_only=True)
class AnswerMissed:
    """The agent has said all that it says to an observation; what it still owes then never comes."""

    agent: str
    text: str


@dataclass(frozen=True, kw_only=True)
class AgentGone:
    """The agent says nothing any more, and why. It comes once and last."""

    agent: str
    reason: str


AgentEvent = AgentJoined | CommandCame | CommandRefused | AnswerMissed | AgentGone
PutEvent = Callable[[AgentEvent], None]
