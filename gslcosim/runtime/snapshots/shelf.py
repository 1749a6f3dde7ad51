"""The snapshots in a run's folder: `snapshots/<tick>/<participant>.snap`, and which of them is whole."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from gslcosim.contract import codec
from gslcosim.contract.messages import Message
from gslcosim.errors import RunFolderError, SnapshotError
from gslcosim.machine import machine_error
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.snapshots.parts import SnapshotPart
from gslcosim.runtime.snapshots.told import TOLD, read_told
from gslcosim.safe_files import replace_file
from gslcosim.scenario import Scenario

SNAPSHOTS = "snapshots"
_SUFFIX = ".snap"


@dataclass(frozen=True, kw_only=True)
class Snapshot:
    """A run's state before the step of `tick`, in `folder`, and all that `agents` had been told by then."""

    folder: Path
    tick: int
    agents: tuple[str, ...]

    @classmethod
    def at(cls, folder: Path, scenario: Scenario) -> "Snapshot":
        """Return the snapshot in a folder, whose name is its tick."""
        return cls(folder=folder, tick=int(folder.name), agents=tuple(agent.name for agent in scenario.agents))

    def part(self, participant: str) -> SnapshotPart:
        """Return what a participant needs.

        Raises:
            SnapshotError: it is missing, damaged or of other code.
        """
        return _part_in(self.folder, participant)

    def messages(self, dataflow: Dataflow) -> list[tuple[str, Message]]:
        """Return the messages that somebody may still need, with their ports."""
        return [
            (port, codec.decode(dataflow.message_types[port], payload))
            for spec in dataflow.participants
            if (self.folder / f"{spec.name}{_SUFFIX}").is_file()
            for port, payload in self.part(spec.name).outputs
        ]

    def told(self) -> Iterator[list[tuple[str, bytes]]]:
        """Yield for each tick before the snapshot the observations, by agent."""
        streams = [read_told(self.folder.parent / TOLD, agent) for agent in self.agents]
        for _ in range(self.tick):
            yield [(agent, next(stream)) for agent, stream in zip(self.agents, streams, strict=True)]


def save_part(run_dir: RunDir, part: SnapshotPart) -> None:
    """Write a part of a snapshot at once.

    Raises:
        RunFolderError: it cannot be written.
    """
    name = f"{SNAPSHOTS}/{part.tick:09d}/{part.participant}{_SUFFIX}"
    try:
        run_dir.make_folders(name)
        replace_file(run_dir.path, name, part.to_bytes())
    except OSError as error:
        raise RunFolderError(str(machine_error(error, name, "a file that can be written"))) from error


def latest_parts(run_dir: RunDir, participants: Sequence[str]) -> list[SnapshotPart]:
    """Return the parts of one process at the last tick of which all its participants have one; empty: there is none."""
    for folder in reversed(_folders(run_dir)):
        try:
            return [_part_in(folder, participant) for participant in participants]
        except SnapshotError:
            continue
    return []


def nearest_snapshot(
    run_dir: RunDir, scenario: Scenario, participants: Sequence[str], *, until_tick: int
) -> tuple[Snapshot | None, str]:
    """Return the last snapshot at or before a tick that can be used, or why there is none, as a sentence.

    Args:
        run_dir: The run's folder.
        scenario: The run's; what its agents were told must be there too.
        participants: Those whose parts it takes.
        until_tick: The tick.
    """
    folders = [folder for folder in _folders(run_dir) if int(folder.name) <= until_tick]
    reason = ""
    for folder in reversed(folders):
        snapshot = Snapshot.at(folder, scenario)
        try:
            for participant in participants:
                snapshot.part(participant)
            for _ in snapshot.told():
                pass
        except SnapshotError as error:
            reason = (
                reason or f"The snapshot of {run_dir.run_id} at tick {snapshot.tick} cannot be used: it is {error}."
            )
        else:
            return snapshot, ""
    return None, reason


def _folders(run_dir: RunDir) -> list[Path]:
    shelf = run_dir.path / SNAPSHOTS
    return sorted(folder for folder in shelf.glob("*") if folder.name.isdecimal()) if shelf.is_dir() else []


def _part_in(folder: Path, participant: str) -> SnapshotPart:
    try:
        data = (folder / f"{participant}{_SUFFIX}").read_bytes()
    except OSError as error:
        raise SnapshotError(f"without the part of {participant} ({error.strerror})") from error
    part = SnapshotPart.from_bytes(data)
    if part.participant != participant or part.tick != int(folder.name):
        raise SnapshotError("damaged")
    return part
