"""Loop over the participants of one process: steps those that can, paces them, and takes their snapshots."""

import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from gslcosim.base.ticks import ticks_from_seconds
from gslcosim.contract.messages import Message, Verdict
from gslcosim.contract.participant import Core, Episode, SupportsClose, SupportsPrefetch, SupportsSummary
from gslcosim.runtime.dataflow import Dataflow
from gslcosim.runtime.replay.snapshot import Snapshot, find_latest_parts, save_part
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.stepper import NO_TICK_LIMIT, PACED_PARTICIPANT, ClockPace, SentMessage, Stepper


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


class StepListener(Protocol):
    """Listener of a step loop, called at each step."""

    def on_outputs(self, stepper: Stepper, outputs: list[SentMessage]) -> None:
        """Take what a participant has written; its readers in this process have it."""
        ...

    def before_snapshot(self, stepper: Stepper) -> None:
        """Let go out what was sent before a participant's state is written."""
        ...

    def after_step(self, stepper: Stepper) -> None:
        """Take note that a participant has finished a tick."""
        ...


class StepLoop:
    """Loop over the participants of one process: all of a run, a group of them, or one.

    What they write for each other is handed over as it is. Whoever runs the loop brings in what comes from elsewhere.

    Attributes:
        steppers: From upstream to downstream.
        acting: The participant that is at fault where something goes wrong now.
    """

    def __init__(
        self,
        cores: Sequence[Core],
        dataflow: Dataflow,
        listener: StepListener,
        *,
        is_whole_run: bool,
        pace: ClockPace | None = None,
        policy: SnapshotPolicy | None = None,
    ) -> None:
        """Prepare to step cores.

        Args:
            cores: From upstream to downstream.
            dataflow: Of the whole run.
            listener: Is called at each step.
            is_whole_run: Whether nobody reads elsewhere; then nobody runs ahead, and no credit is counted.
            pace: Holds the ticks of `PACED_PARTICIPANT` back, if anything does.
            policy: Of snapshots; absent: there are none.
        """
        self._dataflow = dataflow
        self._listener = listener
        self._pace = pace
        self._policy = policy
        self._is_whole_run = is_whole_run
        self._turn = 0
        self.steppers = tuple(
            Stepper(core, dataflow) if policy is None else policy.stepper(core, dataflow) for core in cores
        )
        # Looked for once: it is asked for whenever a process waits, and looking takes longer than a step's bookkeeping.
        self._prefetchers = tuple(
            (stepper, stepper.core.prefetch) for stepper in self.steppers if isinstance(stepper.core, SupportsPrefetch)
        )
        self.acting = self.steppers[0]
        self._readers = {
            port: [stepper for stepper in self.steppers if any(read.port == port for read in stepper.spec.reads)]
            for port in dataflow.writer_of
        }
        self._creditors: dict[str, list[Stepper]] = {stepper.spec.name: [] for stepper in self.steppers}
        for stepper in self.steppers:
            for reader in dataflow.readers_of(stepper.spec.name):
                if is_whole_run:
                    stepper.gate.grant(reader.name, NO_TICK_LIMIT)
                elif reader.name in self._creditors:
                    self._creditors[reader.name].append(stepper)

    @property
    def is_paced(self) -> bool:
        """True when ticks of this process are held back by the clock."""
        return self._pace is not None

    @property
    def last_tick(self) -> int:
        """The last tick that all have finished, -1 before the first."""
        return min(stepper.gate.next_tick for stepper in self.steppers) - 1

    @property
    def is_between_ticks(self) -> bool:
        """True when no participant has begun a tick that others have not; only where the whole run is here."""
        return self._turn == 0

    @property
    def is_finished(self) -> bool:
        """True when all have stepped the run's last tick."""
        return all(stepper.gate.is_finished for stepper in self.steppers)

    def reads(self, port: str) -> bool:
        """Return whether one of them reads a port."""
        return bool(self._readers.get(port))

    def reset(self, episode: Episode) -> Iterator[tuple[Stepper, list[SentMessage]]]:
        """Reset all, one after another, and yield each with what it writes once; hand that over with `pass_on`."""
        for stepper in self.steppers:
            self.acting = stepper
            yield stepper, stepper.reset(episode)

    def resume(self) -> None:
        """Let all that have been reset go on at the snapshot, if the run has one to go on at."""
        if self._policy is not None:
            self._policy.go_on(self.steppers, self._dataflow)

    def step(self) -> bool:
        """Step each one that can, once, so that what one writes is still warm when the next reads it.

        Where the whole run is here it goes tick by tick: nobody begins a tick before all have finished the one before,
        so that nothing is computed, and no agent sees anything, past the verdict.

        Returns whether any has stepped.
        """
        return self._step_in_turn() if self._is_whole_run else self._step_all_that_can()

    def _step_in_turn(self) -> bool:
        has_stepped = False
        for stepper in self.steppers[self._turn :]:
            if self.can_step(stepper):
                self.step_one(stepper)
                has_stepped = True
            elif not stepper.gate.is_finished:
                return has_stepped
            self._turn += 1
        self._turn = 0
        return has_stepped

    def _step_all_that_can(self) -> bool:
        has_stepped = False
        for stepper in self.steppers:
            if self.can_step(stepper):
                self.step_one(stepper)
                has_stepped = True
        return has_stepped

    def can_step(self, stepper: Stepper) -> bool:
        """Return whether the next step of a participant may happen now: its inputs are here, and its time has come."""
        return stepper.gate.can_step() and not self._wait_s(stepper)

    def can_any_step(self) -> bool:
        """Return whether any may step now."""
        return any(map(self.can_step, self.steppers))

    @property
    def pace_wait_s(self) -> float:
        """For how long the clock alone holds back who could step otherwise [s]; everybody waits for that one."""
        if not self.is_paced:
            return 0.0
        return max((self._wait_s(stepper) for stepper in self.steppers if stepper.gate.can_step()), default=0.0)

    def step_one(self, stepper: Stepper) -> None:
        """Step a participant that can, hand over what it writes, and write its state where that is due."""
        self.acting = stepper
        if (pace := self._pace_of(stepper)) is not None:
            pace.begins(stepper.gate.next_tick, time.monotonic())
        self.pass_on(stepper, stepper.step())
        if self._policy is not None and self._policy.is_due(stepper):
            self._listener.before_snapshot(stepper)
            self._policy.write_part(stepper)
        self._listener.after_step(stepper)

    def pass_on(self, stepper: Stepper, outputs: list[SentMessage]) -> None:
        """Hand what a participant has written to its readers; a verdict ends the run."""
        for sent in outputs:
            self.deliver(sent.port, sent.message)
            if isinstance(sent.message, Verdict):
                self.end_at(sent.message.tick)
        for writer in self._creditors[stepper.spec.name]:
            writer.gate.grant(stepper.spec.name, stepper.gate.next_tick - 1)
        self._listener.on_outputs(stepper, outputs)

    def deliver(self, port: str, message: Message) -> bool:
        """Hand a message to all that read its port, and return whether it was new to any."""
        is_new = False
        for reader in self._readers.get(port, ()):
            is_new |= reader.gate.deliver(port, message)
        return is_new

    def grant(self, reader: str, tick: int) -> None:
        """Take note that a reader elsewhere has finished a tick."""
        for stepper in self.steppers:
            stepper.gate.grant(reader, tick)

    def end_at(self, tick: int | None) -> None:
        """Let a tick be the last one of all, where none before it is; None: no tick is."""
        for gate in (stepper.gate for stepper in self.steppers):
            if tick is None or gate.final_tick is None or tick < gate.final_tick:
                gate.final_tick = tick

    def prefetch(self) -> bool:
        """Let one of the cores do what it can without its inputs; return whether there was anything to do."""
        for stepper, prefetch in self._prefetchers:
            self.acting = stepper
            if prefetch():
                return True
        return False

    def close(self, stepper: Stepper) -> None:
        """Let a participant's core write what it holds."""
        self.acting = stepper
        if isinstance(stepper.core, SupportsClose):
            stepper.core.close()

    def summarize(self, stepper: Stepper) -> dict[str, Any]:
        """Return what `result.json` says of a participant."""
        own = dict(stepper.core.summary()) if isinstance(stepper.core, SupportsSummary) else {}
        pace = self._pace_of(stepper)
        return own if pace is None else own | pace.summary()

    def _pace_of(self, stepper: Stepper) -> ClockPace | None:
        return self._pace if stepper.spec.name == PACED_PARTICIPANT else None

    def _wait_s(self, stepper: Stepper) -> float:
        pace = self._pace_of(stepper)
        return 0.0 if pace is None else pace.wait_s(stepper.gate.next_tick, time.monotonic())
