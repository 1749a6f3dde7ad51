"""Policy of snapshots in a run: whose state is saved, when it is written, and how participants resume from it."""

from collections.abc import Collection
from dataclasses import dataclass

from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract.participant import Core
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.replay.snapshot import Snapshot, find_latest_parts, save_part
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.stepper import Stepper


@dataclass(frozen=True, kw_only=True)
class SnapshotPolicy:
    """Policy of a run's snapshots: every so many ticks (None: never), and the snapshot at which it resumes."""

    run_dir: RunDir
    every_ticks: int | None
    snapshot: Snapshot | None
    is_restarting: bool = False

    @classmethod
    def of(cls, setup: RunSetup) -> "SnapshotPolicy":
        """Return what a run's scenario asks for."""
        spec, tick_ns = setup.scenario.snapshots, setup.scenario.tick_ns
        every_ticks = None if spec is None else max(1, ticks_from_seconds(spec.every_s, tick_ns))
        return cls(
            run_dir=setup.run_dir,
            every_ticks=every_ticks,
            snapshot=setup.snapshot,
            is_restarting=setup.scenario.restart is not None,
        )

    @property
    def extra_retained_ticks(self) -> int:
        """For how many ticks more messages are kept: a service that is started again needs them since its snapshot."""
        return self.every_ticks or 0 if self.is_restarting else 0

    def is_kept(self, core: Core) -> bool:
        """Return whether the state of a core is saved or restored; that of one that writes nothing is not.

        What such a one holds are things it has seen, and nobody's next step depends on them.
        """
        return bool(core.spec.writes) and (self.every_ticks is not None or self.snapshot is not None)

    def stepper(self, core: Core, dataflow: Dataflow) -> Stepper:
        """Return what steps a core that has just been built."""
        return Stepper(core, dataflow, is_kept=self.is_kept(core))

    def write_part(self, stepper: Stepper) -> None:
        """Write a participant's part of a snapshot.

        Raises:
            RunFolderError: it cannot be written.
            SnapshotError: something in its core cannot be kept.
        """
        save_part(self.run_dir, stepper.part())

    def is_due(self, stepper: Stepper) -> bool:
        """Return whether a participant is to write its part of a snapshot before its next step."""
        tick, every = stepper.gate.next_tick, self.every_ticks
        return every is not None and stepper.is_kept and tick > 0 and tick % every == 0

    def go_on(self, steppers: Collection[Stepper], dataflow: Dataflow) -> None:
        """Let participants that have been reset go on at the snapshot, if the run has one to go on at.

        Args:
            steppers: Those of this process.
            dataflow: Of the whole run.

        Raises:
            SnapshotError: a part does not fit its participant.
        """
        if self._go_on_where_it_was(steppers):
            return
        snapshot = self.snapshot
        if snapshot is None:
            return
        for stepper in steppers:
            if stepper.is_kept:
                stepper.go_on(snapshot.part(stepper.spec.name))
            else:
                stepper.gate.go_on(snapshot.tick, {})
            # All others stand there too.
            for reader in dataflow.readers_of(stepper.spec.name):
                stepper.gate.grant(reader.name, snapshot.tick - 1)
        for port, message in snapshot.messages(dataflow):
            for stepper in steppers:
                stepper.gate.deliver(port, message)

    # Only a process that is started again finds parts of its own in the run's folder; what else it needs it asks for.
    def _go_on_where_it_was(self, steppers: Collection[Stepper]) -> bool:
        if not self.is_restarting or not all(stepper.is_kept for stepper in steppers):
            return False
        parts = find_latest_parts(self.run_dir, [stepper.spec.name for stepper in steppers])
        for stepper, part in zip(steppers, parts, strict=False):
            stepper.go_on(part)
        return bool(parts)
