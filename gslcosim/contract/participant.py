"""Interface between models and the runtime: cores, their declarations, and optional capabilities."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from gslcosim.contract.messages import Message

# Far enough ahead that writers seldom wait for credit, which is reported four times in as many ticks.
WINDOW_TICKS = 256
# Prefix of the names of agents' participants; no other participant's name begins with it.
AGENT_PREFIX = "agent_"
Inbox = Mapping[str, Message]
Outbox = Mapping[str, Message]


@dataclass(frozen=True, kw_only=True)
class Write:
    """A port that a participant writes: one message at tick 0 and every `period_ticks` after it.

    `announced_in` names a port whose messages determine the ticks at which this port carries a message instead (see
    `Message.announced_ports`); `period_ticks` then has no meaning. Messages with `is_for_recording` depend on the
    recording's settings: they are left out of the comparison with a repetition that is recorded otherwise.
    """

    port: str
    message_type: type[Message]
    period_ticks: int = 1
    announced_in: str | None = None
    is_for_recording: bool = False


@dataclass(frozen=True, kw_only=True)
class Read:
    """A port that a participant reads: to step tick k it needs the message of tick k - delay_ticks, if there is one."""

    port: str
    delay_ticks: int = 0


@dataclass(frozen=True, kw_only=True)
class ParticipantSpec:
    """Declared dataflow of one participant; it steps every tick from 0.

    `window_ticks` is the credit: no writer this participant reads from runs further ahead of it.
    """

    name: str
    reads: tuple[Read, ...]
    writes: tuple[Write, ...]
    window_ticks: int = WINDOW_TICKS


def get_agent_participant(agent: str) -> str:
    """Return the name of the participant that stands for an agent."""
    return f"{AGENT_PREFIX}{agent}"


@dataclass(frozen=True, kw_only=True)
class Episode:
    """One run of a scenario: the seed from which all its random streams derive.

    `is_warmup` means that a few synthetic ticks and another reset follow: purely time-consuming work may be left out.
    """

    seed: int
    is_warmup: bool = False


class Core(Protocol):
    """A model that is independent of where it runs: no process, no socket, no clock."""

    @property
    def spec(self) -> ParticipantSpec:
        """Return the declared reads and writes."""
        ...

    def reset(self, episode: Episode) -> Outbox:
        """Return to the state before tick 0; return the messages that are written once (may be empty)."""
        ...

    def step(self, tick: int, inbox: Inbox) -> Outbox:
        """Advance to the end of `tick` and return one message for each port that is due at it.

        Args:
            tick: 0, 1, 2, … without gaps; tick 0 is the initial state.
            inbox: For each declared read the message of `tick - delay_ticks`; a port is missing from it
                where no message exists (before tick 0, between periods, not announced, closed).
        """
        ...


@runtime_checkable
class SupportsClose(Protocol):
    """Core that holds an open resource, such as a file; it is closed after the last tick, however the run ended."""

    def close(self) -> None:
        """Release the resource; called once."""
        ...


@runtime_checkable
class SupportsSummary(Protocol):
    """Core that adds figures to `result.json` beside the verdict."""

    def summary(self) -> Mapping[str, Any]:
        """Return the figures by key of `result.json`, in plain values; called after the last tick."""
        ...


@runtime_checkable
class SupportsPrefetch(Protocol):
    """Core that can do a part of its work before its inputs are there."""

    def prefetch(self) -> bool:
        """Do a small part of the work that any later step needs; return whether there was any left.

        It may be called whenever the core waits for inputs: the core's messages must not depend on it.
        """
        ...


@runtime_checkable
class SupportsSnapshots(Protocol):
    """Core that reads and restores its state itself, because it holds opaque objects, such as a C library's.

    The runtime inspects the state of all other cores by itself; see `docs/snapshots.md`.
    """

    def state(self) -> Mapping[str, Any]:
        """Return all that the next steps depend on and `reset` does not restore: plain values and bytes, as in msgpack.

        It is called between two steps, any number of times, and changes nothing.
        """
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restore a state that a core of the same scenario and code has returned; called after `reset`."""
        ...


@runtime_checkable
class SupportsWarmup(Protocol):
    """Core that uses kernels in a run that its first ticks do not reach."""

    def warm_up(self) -> None:
        """Call those kernels once, after the synthetic ticks and before the reset that starts the run."""
        ...
