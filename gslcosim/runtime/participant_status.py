"""Status of a run's participants, and from it the explanation of a stall: the chain of participants that wait."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from gslcosim.contract.participant import get_agent_participant

# These values come from other hosts, so numbers and names are checked.
MAX_TICK = 1 << 53
Tick = Annotated[int, Field(ge=-1, le=MAX_TICK)]
ParticipantName = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}$")]
PortName = Annotated[
    str, StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}(/[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}){0,9}$")
]
ParticipantState = Literal["joining", "working", "waiting", "deciding", "done", "silent"]


@dataclass(frozen=True, kw_only=True)
class MissingMessage:
    """A message that a participant lacks: its port, tick and writer, and the last tick that came on the port.

    `last_tick` is -1 where nothing came on it yet.
    """

    port: PortName
    tick: Tick
    writer: ParticipantName
    last_tick: Tick


@dataclass(frozen=True, kw_only=True)
class ParticipantStatus:
    """Status of a participant at one moment.

    `tick` is the last one finished, -1 before the first. It waits for the messages in `missing`, and for the readers in
    `lacking_credit`, which lag behind by as much as they may; both are empty if it waits for nothing. `occupied_s` is
    the duration of its present step or decision so far [s], absent outside of one; `queued_ticks` counts the ticks of
    its inputs that are here already. A participant that is `silent` has not answered. Of its process: `pid`, CPU time
    so far, and its private memory plus its share of shared memory; absent if unknown. `n_resends` counts messages that
    it had to request again.
    """

    name: str
    state: ParticipantState
    tick: int
    missing: tuple[MissingMessage, ...] = ()
    lacking_credit: tuple[str, ...] = ()
    occupied_s: float | None = None
    queued_ticks: int = 0
    pid: int | None = None
    cpu_s: float | None = None
    memory_bytes: int | None = None
    n_resends: int = 0

    @property
    def waits_for(self) -> tuple[str, ...]:
        """The ports and the readers that it waits for, each once."""
        return tuple(dict.fromkeys([*(missing.port for missing in self.missing), *self.lacking_credit]))


@dataclass(frozen=True)
class Stall:
    """A stalled run: all others wait for the participant `culprit`; `lines` explain it, one for each."""

    culprit: str
    lines: tuple[str, ...]

    @property
    def text(self) -> str:
        """The explanation, a line for each participant that takes part in it, the culprit first."""
        return "\n".join(self.lines)


def explain_stall(participants: Sequence[ParticipantStatus]) -> Stall | None:
    """Return the participant that holds a run up, and the chain that waits for it; None if all have done their part.

    The chain begins at the participant furthest behind among those that wait. It leads from the message that this one
    lacks to the writer of the message, and so on, to a participant that waits for no other: it is in its step, owes an
    answer, or is silent. In a chain that comes back to a participant, all wait for each other, and the one furthest
    behind is returned.
    """
    by_name = {participant.name: participant for participant in participants}
    # Messages of agents come from their sessions; no service has the name of a session.
    by_name |= {get_agent_participant(name): participant for name, participant in by_name.items()}
    # An agent that waits for no message has answered all requests.
    open_ones = [each for each in participants if each.state not in ("done", "waiting") or each.waits_for]
    if not open_ones:
        return None
    waiting = [participant for participant in open_ones if _find_blocker(participant)]
    current = min(waiting or open_ones, key=lambda participant: participant.tick)
    chain: list[ParticipantStatus] = []
    while current not in chain:
        chain.append(current)
        following = by_name.get(_find_blocker(current))
        if following is None:
            break
        current = following
    else:
        circle = chain[chain.index(current) :]
        culprit = min(circle, key=lambda participant: participant.tick)
        lines = (f"{culprit.name} and what it waits for wait for each other: a message is missing, not late.",)
        return Stall(culprit.name, (*lines, *(_describe_wait(participant) for participant in chain)))
    return Stall(chain[-1].name, tuple(_describe_wait(participant) for participant in reversed(chain)))


def _describe_wait(participant: ParticipantStatus) -> str:
    """Return a sentence on the work or wait of a participant: the tick, the port, its writer, the last message."""
    name, tick = participant.name, participant.tick + 1
    for_s = "" if participant.occupied_s is None else f" for {participant.occupied_s:.1f} s"
    if participant.state == "silent":
        return f"{name} does not answer: its process is stopped, or hangs. It last reported tick {participant.tick}."
    if participant.state == "joining":
        return f"{name} has not joined."
    if participant.state == "deciding":
        return f"{name} owes a command for tick {participant.tick}{for_s}."
    if participant.missing:
        return f"{name} waits at tick {tick} for {', '.join(map(_describe_missing, participant.missing))}."
    if participant.lacking_credit:
        readers = ", ".join(participant.lacking_credit)
        return f"{name} waits at tick {tick} for {readers} to catch up: it is as far ahead as it may be."
    if for_s:
        return f"{name} is in its step of tick {tick}{for_s}."
    return f"{name} waits for nobody at tick {tick}."


def _find_blocker(participant: ParticipantStatus) -> str:
    if participant.missing:
        return participant.missing[0].writer
    return participant.lacking_credit[0] if participant.lacking_credit else ""


def _describe_missing(missing: MissingMessage) -> str:
    last = "nothing yet" if missing.last_tick < 0 else f"tick {missing.last_tick} last"
    return f"{missing.port} of tick {missing.tick} from {missing.writer} (got {last})"
