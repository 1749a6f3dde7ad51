"""How a check starts an agent and speaks to it: what it is told, and what comes back."""

import queue
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

from gslcosim.errors import UsageError
from gslcosim.gateway.framing import FrameFormat
from gslcosim.methods.card import Needs, card_beside
from gslcosim.runtime.agents.events import AgentEvent
from gslcosim.runtime.agents.links import AgentLink

DoorKind = Literal["zenoh", "stdio", "tcp", "unix"]


@dataclass(frozen=True)
class AgentExited:
    """The agent's process has ended."""

    exit_code: int


@dataclass(frozen=True)
class AgentGivenUp:
    """The link has given the agent up, and why."""

    reason: str


@dataclass(frozen=True)
class StrayCame:
    """The agent wrote something where it must not."""

    text: str


@dataclass(frozen=True)
class QuestionAsked:
    """The agent put a question to the bus; nobody answers any."""

    key: str


WireEvent = AgentEvent | AgentExited | AgentGivenUp | StrayCame | QuestionAsked


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """How an agent is started and spoken to: its command line, its door, and for the gateway format and choice."""

    command: tuple[str, ...]
    door: DoorKind = "zenoh"
    format: FrameFormat = "msgpack"
    observations: Literal["all", "asked"] = "all"
    directory: Path = field(default_factory=Path.cwd)

    def check(self) -> None:
        """Check that there is a program to start.

        Raises:
            UsageError: there is none.
        """
        program = self.command[0] if self.command else ""
        if not program or shutil.which(program, path=None if "/" not in program else str(self.directory)) is None:
            beside = self.directory / program
            if "/" in program and shutil.which(str(beside)) is not None:
                return
            raise UsageError(
                f"expected an agent's command that can be started, was {program!r}.\nFolder: {self.directory}"
            )

    def needs(self) -> Needs:
        """Return what the method card beside the agent's program says that it needs; nothing where there is no card.

        Raises:
            MethodError: the card is wrong.
        """
        for word in self.command:
            program = self.directory / word
            card = card_beside(program) if program.is_file() else None
            if card is not None:
                return card.needs
        return Needs()


class Wire(AgentLink, Protocol):
    """One start of an agent, and the link to it. `events` holds what it does, in order.

    Payloads need not be those of a run: a check may add to them. `repeat` sends briefing and last question again,
    whatever the link; `joins_by_start` says that an agent joins by being started, without a word of its own;
    `left_over`, after `stop`, are processes that had outlived the agent.
    """

    events: "queue.SimpleQueue[WireEvent]"
    joins_by_start: bool
    left_over: tuple[str, ...]

    def start(self) -> None:
        """Start the agent's process."""
        ...

    def unheard(self) -> tuple[str, ...]:
        """Return which of its own keys the agent did not listen to when it joined."""
        ...

    def overheard(self) -> tuple[str, ...]:
        """Return which keys of others the agent listens to."""
        ...

    def cut(self) -> None:
        """End the link without a word."""
        ...

    def stop(self) -> str:
        """End whatever is left of the agent; return the end of its log."""
        ...
