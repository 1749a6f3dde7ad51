"""One run from a loaded scenario to a run directory: the entry point of the runtime."""

import threading
import time
import traceback
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from gslcosim.base.disk_cache import keep_within_limit, mark_used
from gslcosim.base.errors import MachineError, RecordingError, UsageError, format_fault
from gslcosim.base.processes import is_asked_to_end
from gslcosim.base.untrusted_input import MalformedFileError
from gslcosim.environment.generation.cache import load_rooms, prepare_environment
from gslcosim.runtime.agents.validator import RecordedCommands
from gslcosim.runtime.distributed.process_launch import run_distributed
from gslcosim.runtime.external.core import hash_programs
from gslcosim.runtime.kernel_compilation import KernelFolder, compile_agent_kernels
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault
from gslcosim.runtime.processes.fork_server import ForkServer
from gslcosim.runtime.processes.sandbox.selection import describe_sandboxes
from gslcosim.runtime.replay.snapshot import Snapshot
from gslcosim.runtime.run_dir import RunDir, note_sandboxes
from gslcosim.runtime.services import list_services, plan_processes
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult, RunStatus, StatusServer
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import LoadedScenario, dump_resolved
from gslcosim.scenario.models.scenario import Processes

LOOK_EVERY_S = 0.5
TEXT = "compiling kernels"
_TEXT_OF_PREPARATION = "compiling kernels, about a minute and only on the first run of a version"

StatusHandler = Callable[[RunStatus], None]


@dataclass(frozen=True, kw_only=True)
class PriorRun:
    """Past that a run takes over from another: its environment, its commands, and the origin for the manifest.

    `snapshot` is where it goes on; absent: it begins at tick 0.
    """

    environment_dir: Path
    past: RecordedCommands
    origin: Mapping[str, Any]
    snapshot: Snapshot | None = None


@dataclass(frozen=True, kw_only=True)
class RunPlan:
    """Inputs that decide a run's result, and the place of its folder.

    It began at `began` by `time.perf_counter` [s]; `origin` holds facts about a run that is repeated, for the manifest.
    The others are those of `RunSetup`.
    """

    scenario: Scenario
    environment_dir: Path
    runs_dir: Path
    directory: Path
    processes: Processes
    began: float
    origin: Mapping[str, Any] | None = None
    past: RecordedCommands | None = None
    paced_from_tick: int | None = None
    snapshot: Snapshot | None = None
    sources: tuple[Path, ...] = ()


def run_scenario(
    loaded: LoadedScenario,
    *,
    runs_dir: Path,
    processes: Processes | None = None,
    network: Network | None = None,
    fork_server: ForkServer | None = None,
    report: StatusHandler = lambda _: None,
    repetition: PriorRun | None = None,
) -> RunResult:
    """Run a scenario and leave a run directory, whatever happens in between.

    Args:
        processes: Distribution of the run over processes; absent: that of the scenario.
        network: Access to the run's router; ignored in one process.
        fork_server: Forks the services; absent: one is started where it is needed.
        repetition: Past that is taken over from another run; absent: none.

    Raises:
        GslCosimError: the scenario cannot be run at all (its environment or dataflow is wrong).
        MachineError: no run directory can be made.
    """
    began = time.perf_counter()
    scenario, directory = loaded.scenario, loaded.directory
    network = network or Network()
    processes = scenario.processes if processes is None else processes
    is_one_process = processes == "one"

    groups = plan_processes(scenario, processes, network)
    if scenario.snapshots is not None and network.elsewhere:
        raise UsageError(
            "snapshots: expected all services started here, which write them into the run's folder, was --elsewhere "
            f"{' '.join(network.elsewhere)}. Leave out snapshots, or take them with gslcosim replay."
        )
    for agent in scenario.agents:
        if agent.start.attach and agent.start.door == "tcp":
            network.check_gateway(agent.name)
    sandboxes = describe_sandboxes(scenario, is_one_process=is_one_process)

    if repetition is not None:
        environment_dir = repetition.environment_dir
    else:
        with CompilationReporter(report) as reporter:
            progress = _PreparationReporter(reporter)
            environment_dir = prepare_environment(scenario, scenario_dir=directory, progress=progress)
    compile_agent_kernels(
        scenario,
        directory,
        is_one_process=is_one_process,
        notify=lambda name: _PreparationReporter(report)(f"compiling kernels of {name}", 0.0),
    )

    plan = RunPlan(
        scenario=scenario,
        environment_dir=environment_dir,
        runs_dir=runs_dir,
        directory=directory,
        processes=processes,
        began=began,
        origin=repetition and repetition.origin,
        past=repetition and repetition.past,
        # Repeated ticks need not wait for any clock.
        paced_from_tick=repetition.past.until_tick if repetition is not None else 0,
        snapshot=repetition and repetition.snapshot,
        sources=(loaded.path.absolute(), *loaded.included),
    )
    with OpenRun(plan, report) as run:
        setup = run.prepare()
        if scenario.recording.enabled:
            note_sandboxes(setup.run_dir.path, sandboxes)
        if is_one_process:
            from gslcosim.runtime.in_process import run_in_process

            run.outcome = run_in_process(setup, directory, network, run.report)
        else:
            run.outcome = run_distributed(setup, directory, network, run.report, groups, fork_server)
        run.outcome.sandboxes = sandboxes
    return run.result


class OpenRun:
    """Run with a folder: a context that leaves a result in it, whatever ends the run.

    Inside, `prepare` returns the setup, the run's host gets `report`, and the caller sets `outcome`. An exception
    becomes the outcome's fault, and goes no further. `result` is there once the context is left.
    """

    result: RunResult

    def __init__(self, plan: RunPlan, report: StatusHandler) -> None:
        self.outcome = RunOutcome()
        self.report = self._caller_report = report
        self._plan = plan
        self._environments = [plan.environment_dir]
        self._compilation: CompilationReporter | None = None
        self._contexts = ExitStack()

    def __enter__(self) -> Self:
        """Make the folder.

        Raises:
            MachineError: it cannot be made.
        """
        plan = self._plan
        self._run_dir = RunDir.create(plan.runs_dir, name=plan.scenario.name, seed=plan.scenario.seed)
        self._preparation_s = time.perf_counter() - plan.began
        self.report = window = StatusServer(self._run_dir, plan.scenario, plan.processes, self.report)
        self._contexts.callback(window.close)
        return self

    def prepare(self) -> RunSetup:
        """Write scenario, setup, manifest, and the rooms of later events."""
        plan, run_dir = self._plan, self._run_dir
        run_dir.replace(run_dir.scenario.name, dump_resolved(plan.scenario))
        progress = _PreparationReporter(self.report)
        environment, later_rooms = load_rooms(
            plan.environment_dir, plan.scenario, scenario_dir=plan.directory, progress=progress
        )
        self._environments += later_rooms.values()
        setup = RunSetup(
            run_dir=run_dir,
            scenario=plan.scenario,
            environment_dir=plan.environment_dir.resolve(),
            environment=environment,
            later_rooms=later_rooms,
            sources=plan.sources,
            directory=plan.directory.absolute(),
            past=plan.past,
            paced_from_tick=plan.paced_from_tick,
            snapshot=plan.snapshot,
        )
        setup.save()
        participants = plan.scenario.participants
        run_dir.save_manifest(
            seed=plan.scenario.seed,
            environment_hash=setup.environment.content_hash,
            processes=plan.processes,
            origin=plan.origin,
            programs=hash_programs(participants, plan.directory) if participants else None,
        )
        self.report(RunStatus(state="starting", run_dir=run_dir.path))
        for folder in self._environments:
            mark_used(folder)
        self._compilation = self._contexts.enter_context(CompilationReporter(self.report))
        self.report = self._compilation
        return setup

    # The result of a run with a folder holds whatever ended it: wrong input, a refusal of the machine, or a bug.
    def __exit__(self, _: type[BaseException] | None, error: BaseException | None, __: TracebackType | None) -> bool:
        self._contexts.close()
        if isinstance(error, KeyboardInterrupt) or (isinstance(error, Exception) and is_asked_to_end()):
            # Outside of the part that handles interruptions itself.
            self.outcome = RunOutcome(is_interrupted=True)
        elif isinstance(error, Exception):
            text = format_fault(error, "".join(traceback.format_exception(error)))
            self.outcome = RunOutcome(fault=ServiceFault(participant="supervisor", tick=0, text=text))
        elif error is not None:
            return False
        else:
            self.outcome.require_reason()
            if self._compilation is not None and self._compilation.has_compiled:
                keep_within_limit()
        self.outcome.preparation_s = self._preparation_s
        self._repair_recording()
        self._save_digest()
        result = self._save_result()
        status = RunStatus(state="ended", sim_time_s=result["sim_time_s"], real_time_factor=result["real_time_factor"])
        self._caller_report(status)
        self.result = RunResult(exit_code=int(self.outcome.exit_code), run_dir=self._run_dir.path, result=result)
        return True

    def _repair_recording(self) -> None:
        recording = self._run_dir.recording
        if self.outcome.is_valid or not recording.exists():
            return
        if recording.stat().st_size == 0:
            recording.unlink()
            return
        try:
            for kind in list_services(self._plan.scenario):
                if kind.repair is not None:
                    kind.repair(recording)
        except (RecordingError, OSError) as error:
            # The recorder had not written its first bytes; that must not hide the reason of the end.
            self._add_fault(f"The recording was not made whole: {format_fault(error, '')}")

    def _save_digest(self) -> None:
        if self.outcome.digest is None:
            return
        try:
            self.outcome.digest.save(self._run_dir.digest)
        except MachineError as error:
            self._add_fault(str(error))

    def _save_result(self) -> dict[str, Any]:
        result = self._build_result()
        try:
            self._run_dir.save_result(result)
        except MachineError as error:
            self._add_fault(str(error))
            return self._build_result()
        return result

    def _build_result(self) -> dict[str, Any]:
        try:
            manifest = self._run_dir.load_manifest()
        except MalformedFileError:
            manifest = None  # a run that failed early has none
        return self.outcome.as_result(
            self._plan.scenario,
            run_id=self._run_dir.run_id,
            wall_s=time.perf_counter() - self._plan.began,
            validity=self.outcome.assess(self._plan.scenario, self._environments, manifest),
        )

    def _add_fault(self, text: str) -> None:
        fault = self.outcome.fault
        if fault is None:
            self.outcome.fault = ServiceFault(participant="supervisor", tick=self.outcome.ticks_flown, text=text)
        elif text not in fault.text:
            self.outcome.fault = replace(fault, text=f"{fault.text}\n{text}")


class CompilationReporter:
    """Context and status handler that adds the compilation of kernels to the status of a starting run.

    A first run of a version compiles for a minute, and one in a single process has nothing else to report meanwhile.

    Attributes:
        has_compiled: True if kernels were compiled.
    """

    def __init__(self, report: Callable[[RunStatus], None], folder: KernelFolder | None = None) -> None:
        self._report = report
        self._folder = folder or KernelFolder()
        # Kept in the cache while this process lives.
        mark_used(self._folder.path)
        self._guard = threading.Lock()
        self._last: RunStatus | None = None
        self.has_compiled = False
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watches kernels", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join()

    def __call__(self, status: RunStatus) -> None:
        """Report a status."""
        with self._guard:
            self._last = status
            if status.state not in ("preparing", "starting"):
                self._is_over.set()
            self._report(self._completed(status))

    def _watch(self) -> None:
        while not self._is_over.wait(LOOK_EVERY_S):
            if not self._folder.has_new():
                continue
            with self._guard:
                if not self._is_over.is_set():
                    self.has_compiled = True
                    last = self._last or RunStatus(state="starting")
                    self._report(self._completed(replace(last, run_dir=None)))

    def _completed(self, status: RunStatus) -> RunStatus:
        if not self.has_compiled or status.state not in ("preparing", "starting"):
            return status
        if status.state == "preparing":
            return replace(status, text=f"{status.text}, {_TEXT_OF_PREPARATION}", is_compiling=True)
        text = ", ".join(filter(None, (TEXT, status.text)))
        return replace(status, text=text, fraction=self._folder.estimate_fraction(), is_compiling=True)


@dataclass
class _PreparationReporter:
    """Reporter of the preparation of a run as its status."""

    report: StatusHandler

    def __call__(self, text: str, fraction: float) -> None:
        self.report(RunStatus(state="preparing", text=text, fraction=fraction))
