"""Declared dataflow of a run: the readers and the writer of each port, checked before the start."""

from collections.abc import Iterable, Mapping, Sequence

from gslcosim.base.errors import DataflowError
from gslcosim.contract.participant import ParticipantSpec, Write

ONCE = "once"


class Dataflow:
    """All participants of a run with their reads and writes, checked.

    Attributes:
        participants: Their declarations.
        by_name: The participants by name.
        writes: The declaration of each port.
        writer_of: The participant that writes each port.
        message_types: The message type of each port.
        recording_ports: The ports whose messages depend on how a run is recorded.
        readers_of: By participant, the others that read anything it writes.
        order: The participants so that within a tick each comes after all it waits for.

    Args:
        participants: Their declarations.
    """

    def __init__(self, participants: tuple[ParticipantSpec, ...]) -> None:
        self.participants = participants
        self.by_name = {participant.name: participant for participant in participants}
        self.writes = {write.port: write for participant in participants for write in participant.writes}
        self.writer_of = {write.port: participant.name for participant in participants for write in participant.writes}
        self.message_types = {port: write.message_type for port, write in self.writes.items()}
        self.recording_ports = frozenset(port for port, write in self.writes.items() if write.is_for_recording)
        problems = [*find_port_problems(participants), *self._announcement_problems()]
        if not problems and (cycle := find_undelayed_cycle(participants)):
            problems = [f"{' → '.join([*cycle, cycle[0]])}: expected a delay of at least 1 tick on one of these reads."]
        if problems:
            raise DataflowError("The dataflow cannot run:\n" + "\n".join(f"  {problem}" for problem in problems))
        readers: dict[str, dict[str, ParticipantSpec]] = {name: {} for name in self.by_name}
        for reader in participants:
            for read in reader.reads:
                if (writer := self.writer_of[read.port]) != reader.name:
                    readers[writer][reader.name] = reader
        self.readers_of = {name: tuple(others.values()) for name, others in readers.items()}
        waits = {participant.name: _list_awaited(participant, self.writer_of) for participant in participants}
        order: list[str] = []
        while len(order) < len(waits):
            order.append(next(name for name, awaited in waits.items() if name not in order and awaited <= {*order}))
        self.order = tuple(order)

    def describe(self) -> str:
        """Return the graph as text: one line for each participant, in the order of a tick."""
        lines: list[str] = []
        for name in self.order:
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
    """Yield the problems of participants' ports: no writer or several, or an impossible delay."""
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
