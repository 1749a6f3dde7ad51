"""Declared dataflow of a run: who reads what from whom, checked before anything starts."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from gslcosim.base.errors import DataflowError
from gslcosim.contract.messages import Message
from gslcosim.contract.participant import ParticipantSpec, Write

ONCE = "once"


@dataclass(frozen=True)
class Dataflow:
    """All participants of a run with their reads and writes."""

    participants: tuple[ParticipantSpec, ...]

    def __post_init__(self) -> None:
        problems = [*find_port_problems(self.participants), *self._announcement_problems()]
        if not problems and (cycle := find_undelayed_cycle(self.participants)):
            problems = [f"{' → '.join([*cycle, cycle[0]])}: expected a delay of at least 1 tick on one of these reads."]
        if problems:
            raise DataflowError("The dataflow cannot run:\n" + "\n".join(f"  {problem}" for problem in problems))

    @cached_property
    def by_name(self) -> dict[str, ParticipantSpec]:
        """The participants by name."""
        return {participant.name: participant for participant in self.participants}

    @cached_property
    def writes(self) -> dict[str, Write]:
        """The declaration of each port."""
        return {write.port: write for participant in self.participants for write in participant.writes}

    @cached_property
    def writer_of(self) -> dict[str, str]:
        """The participant that writes each port."""
        return {write.port: participant.name for participant in self.participants for write in participant.writes}

    @cached_property
    def message_types(self) -> dict[str, type[Message]]:
        """The message type of each port."""
        return {port: write.message_type for port, write in self.writes.items()}

    @cached_property
    def recording_ports(self) -> frozenset[str]:
        """The ports whose messages depend on how a run is recorded."""
        return frozenset(port for port, write in self.writes.items() if write.is_for_recording)

    def readers_of(self, name: str) -> tuple[ParticipantSpec, ...]:
        """Return the other participants that read anything a participant writes."""
        mine = {write.port for write in self.by_name[name].writes}
        return tuple(p for p in self.participants if p.name != name and any(read.port in mine for read in p.reads))

    def order(self) -> tuple[str, ...]:
        """Return the participants so that within a tick each comes after all it waits for."""
        done: list[str] = []
        while len(done) < len(self.participants):
            ready = [
                p.name for p in self.participants if p.name not in done and _list_awaited(p, self.writer_of) <= {*done}
            ]
            done.append(ready[0])
        return tuple(done)

    def describe(self) -> str:
        """Return the graph as text: one line for each participant, in the order of a tick."""
        lines: list[str] = []
        for name in self.order():
            participant = self.by_name[name]
            reads = ", ".join(f"{r.port}[k-{r.delay_ticks}]" if r.delay_ticks else r.port for r in participant.reads)
            writes = ", ".join(_format_write(write) for write in participant.writes)
            lines.append(f"{name}: reads {reads or 'nothing'}; writes {writes or 'nothing'}")
        return "\n".join(lines) + "\n"

    def _announcement_problems(self) -> Iterable[str]:
        for participant in self.participants:
            known = {read.port: read.delay_ticks for read in participant.reads}
            own = {write.port for write in participant.writes}
            for read in participant.reads:
                announcer = self.writes[read.port].announced_in if read.port in self.writes else None
                if announcer is None or announcer in own:
                    continue
                if announcer not in known or known[announcer] > read.delay_ticks:
                    yield (
                        f"{participant.name} reads {read.port}: expected it to read {announcer} too (which announces "
                        f"it), with a delay of at most {read.delay_ticks} ticks."
                    )


def find_port_problems(participants: Sequence[ParticipantSpec]) -> Iterable[str]:
    """Yield what is wrong with the ports of participants: no writer or several, or an impossible delay."""
    written: dict[str, str] = {}
    for participant in participants:
        for write in participant.writes:
            if write.port in written:
                yield f"{write.port}: expected one writer, found {written[write.port]} and {participant.name}."
            written[write.port] = participant.name
    for participant in participants:
        for read in participant.reads:
            if read.port not in written:
                yield f"{participant.name} reads {read.port}: expected a writer, found none."
            if read.delay_ticks < 0:
                yield f"{participant.name} reads {read.port}: expected a delay >= 0, was {read.delay_ticks}."
            if written.get(read.port) == participant.name and read.delay_ticks == 0:
                yield f"{participant.name} reads its own {read.port}: expected a delay of at least 1 tick."


def find_undelayed_cycle(participants: Sequence[ParticipantSpec]) -> list[str]:
    """Return the participants of a ring of reads without any delay, in the order of writing; empty without one."""
    writer_of = {write.port: participant.name for participant in participants for write in participant.writes}
    open_nodes = {participant.name: _list_awaited(participant, writer_of) for participant in participants}
    while free := [name for name, waits in open_nodes.items() if not waits & open_nodes.keys()]:
        for name in free:
            del open_nodes[name]
    if not open_nodes:
        return []
    path = [min(open_nodes)]
    while (following := min(open_nodes[path[-1]] & open_nodes.keys())) not in path:
        path.append(following)
    return path[path.index(following) :][::-1]


# The participants whose output of the same tick this one needs.
def _list_awaited(participant: ParticipantSpec, writer_of: Mapping[str, str]) -> set[str]:
    undelayed = (read for read in participant.reads if read.delay_ticks == 0)
    return {writer_of[read.port] for read in undelayed} - {participant.name}


def _format_write(write: Write) -> str:
    if write.announced_in == ONCE:
        return f"{write.port} (once)"
    if write.announced_in:
        return f"{write.port} (announced in {write.announced_in})"
    return write.port if write.period_ticks == 1 else f"{write.port} (every {write.period_ticks} ticks)"
