"""One run from a loaded scenario to a run directory: the entry point of the runtime."""

import os
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from gslcosim.base.disk_cache import keep_within_limit, mark_used
from gslcosim.base.errors import MachineError, RecordingError, UsageError, format_fault
from gslcosim.base.kernel_cache import NUMBA_VARIABLE
from gslcosim.base.processes import is_asked_to_end
from gslcosim.base.untrusted_input import MalformedFileError
from gslcosim.environment.generation import prepare_environment
from gslcosim.environment.generation.cache import prepare_variants, with_variants
from gslcosim.environment.store import load_environment
from gslcosim.runtime.agents.kernel_warmup import compile_agent_kernels
from gslcosim.runtime.agents.validator import RecordedCommands
from gslcosim.runtime.distributed.process_launch import run_distributed
from gslcosim.runtime.external.core import hash_programs
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault
from gslcosim.runtime.processes.fork_server import ForkServer
from gslcosim.runtime.processes.sandbox.selection import describe_sandboxes
from gslcosim.runtime.replay.snapshot import Snapshot
from gslcosim.runtime.run_dir import MachineLog, RunDir, RunManifest
from gslcosim.runtime.services import ServiceGroup, build_dataflow, group_services, list_service_names, list_services
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult, RunStatus, StatusServer
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import LoadedScenario, dump_resolved
from gslcosim.scenario.models.scenario import Processes

if TYPE_CHECKING:
    from gslcosim.environment.generation import Progress

LOOK_EVERY_S = 0.5
TEXT = "compiling kernels"
_TEXT_OF_PREPARATION = "compiling kernels, about a minute and only on the first run of a version"


class KernelFolder:
    """The folder in which numba keeps kernels, as it was when this object was made.

    Args:
        folder: It; by default that of this process, which those of a run share.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or Path(os.environ.get(NUMBA_VARIABLE, os.devnull))
        self._before = self._times()

    def has_new(self) -> bool:
        """Return whether kernels were added since."""
        return self._times() != self._before

    def mark_used(self) -> None:
        """Keep it in the cache while this process lives."""
        mark_used(self._folder)

    # Each folder of modules changes when a file is added.
    def _times(self) -> Mapping[str, int]:
        try:
            return {entry.name: entry.stat().st_mtime_ns for entry in os.scandir(self._folder) if entry.is_dir()}
        except OSError:
            return {}


class CompilationReporter:
    """Adds to the status of a run that starts that kernels are compiled; used as a context, and as the report in it.

    A first run of a version compiles for a minute, and one in a single process has nothing else to report meanwhile.

    Args:
        report: Is given the status.
        folder: Where kernels are added.
    """

    def __init__(self, report: Callable[[RunStatus], None], folder: KernelFolder | None = None) -> None:
        self._report = report
        self._folder = folder or KernelFolder()
        self._folder.mark_used()
        self._guard = threading.Lock()
        self._last: RunStatus | None = None
        self._is_compiling = False
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="watches kernels", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._thread.join()

    @property
    def has_compiled(self) -> bool:
        """True if kernels were compiled."""
        return self._is_compiling

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
                    self._is_compiling = True
                    last = self._last or RunStatus(state="starting")
                    self._report(self._completed(replace(last, run_dir=None)))
            return

    def _completed(self, status: RunStatus) -> RunStatus:
        if not self._is_compiling or status.state not in ("preparing", "starting"):
            return status
        if status.state == "preparing":
            return replace(status, text=f"{status.text}, {_TEXT_OF_PREPARATION}", is_compiling=True)
        return replace(status, text=", ".join(filter(None, (TEXT, status.text))), is_compiling=True)


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
        loaded: The scenario and where it came from.
        runs_dir: Where the run directory is made.
        processes: How the run is spread over processes; absent: as the scenario says.
        network: How processes reach the run's router; ignored in one process.
        fork_server: Forks the services; absent: one is started where it is needed.
        report: Receives the status of the run.
        repetition: What is taken over from another run; absent: nothing.

    Raises:
        GslCosimError: the scenario cannot be run at all (its environment or dataflow is wrong).
        MachineError: no run directory can be made.
    """
    began = time.perf_counter()
    scenario = loaded.scenario
    network = network or Network()
    services = list_service_names(scenario)
    build_dataflow(scenario)
    processes = scenario.processes if processes is None else processes
    network.check(services, is_one_process=processes == "one")
    if scenario.snapshots is not None and network.elsewhere:
        raise UsageError(
            "snapshots: expected all services started here, which write them into the run's folder, was --elsewhere "
            f"{' '.join(network.elsewhere)}. Leave out snapshots, or take them with gslcosim replay."
        )
    for agent in scenario.agents:
        if agent.start.attach and agent.start.door == "tcp":
            network.check_gateway(agent.name)
    started_here = [name for name in services if not network.is_remote(name)]
    groups = group_services(processes, started_here) if started_here else ()
    groups = (*groups, *((name,) for name in services if network.is_remote(name)))
    sandboxes = describe_sandboxes(scenario, is_one_process=processes == "one")
    if repetition is not None:
        environment_dir = repetition.environment_dir
    else:
        ahead = None if processes == "one" else fork_server
        with CompilationReporter(report) as reporter:
            environment_dir = _prepare_environment(loaded, reporter, ahead)
    compile_agent_kernels(
        scenario,
        loaded.directory,
        is_one_process=processes == "one",
        notify=lambda name: _build_progress_handler(report)(f"compiling kernels of {name}", 0.0),
    )

    def fly_it(setup: RunSetup, report: StatusHandler) -> RunOutcome:
        setup = replace(setup, past=repetition and repetition.past)
        if scenario.recording.enabled:
            machine = MachineLog(setup.run_dir.path)
            machine.confined(sandboxes)
            machine.close()
        flown = _execute(setup, loaded.directory, network, report, None if processes == "one" else groups, fork_server)
        return replace(flown, sandboxes=sandboxes)

    _, result = run_into_directory(
        scenario,
        environment_dir,
        fly_it,
        runs_dir=runs_dir,
        processes=processes,
        began=began,
        report=report,
        directory=loaded.directory,
        origin=repetition and repetition.origin,
        # What is repeated need not wait for any clock.
        paced_from_tick=repetition.past.until_tick if repetition is not None else 0,
        snapshot=repetition and repetition.snapshot,
        sources=(loaded.path.absolute(), *loaded.included),
    )
    return result


# Where nothing was made before, kernels are compiled for longer than an environment is made: the other core has time.
def _prepare_environment(loaded: LoadedScenario, report: StatusHandler, fork_server: ForkServer | None) -> Path:
    idle_server = fork_server

    def progress(text: str, fraction: float) -> None:
        nonlocal idle_server
        if idle_server is not None:
            from gslcosim.runtime.early_warmup import fork_warmup

            fork_warmup(idle_server, loaded.scenario, loaded.directory)
            idle_server = None
        report(RunStatus(state="preparing", text=text, fraction=fraction))

    return prepare_environment(loaded.scenario, scenario_dir=loaded.directory, progress=progress)


def run_into_directory(
    scenario: Scenario,
    environment_dir: Path,
    fly_it: Callable[[RunSetup, StatusHandler], RunOutcome],
    *,
    runs_dir: Path,
    processes: Processes,
    began: float,
    report: StatusHandler,
    directory: Path,
    origin: Mapping[str, Any] | None = None,
    paced_from_tick: int | None = None,
    snapshot: Snapshot | None = None,
    sources: tuple[Path, ...] = (),
) -> tuple[RunOutcome, RunResult]:
    """Make the folder of a run with all that decides its result, fly, and write what has come of it, whatever it is.

    Args:
        scenario: What is run.
        environment_dir: Where its room is.
        fly_it: Runs it, and reports to the receiver that it is given.
        runs_dir: Where the folder is made.
        processes: How the run is spread over processes.
        began: When it began, by `time.perf_counter` [s].
        report: Receives the status of the run.
        directory: Where relative paths of agents start.
        origin: What the manifest says of the run that is run again.
        paced_from_tick: The first tick that keeps the scenario's pace; absent: none.
        snapshot: Where it goes on; absent: it begins at tick 0.
        sources: The files from which the scenario was resolved.

    Raises:
        MachineError: the folder cannot be made.
    """
    run_dir = RunDir.create(runs_dir, name=scenario.name, seed=scenario.seed)
    environments = [environment_dir]

    preparation_s = time.perf_counter() - began

    def outcome_of_flight(report: StatusHandler) -> RunOutcome:
        run_dir.replace(run_dir.scenario.name, dump_resolved(scenario))
        later_rooms = prepare_variants(scenario, scenario_dir=directory, progress=_build_progress_handler(report))
        environments.extend(later_rooms.values())
        setup = RunSetup(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir.resolve(),
            environment=with_variants(load_environment(environment_dir), later_rooms),
            later_rooms=later_rooms,
            sources=sources,
            directory=directory.absolute(),
            paced_from_tick=paced_from_tick,
            snapshot=snapshot,
        )
        setup.save()
        run_dir.save_manifest(
            seed=scenario.seed,
            environment_hash=setup.environment.content_hash,
            processes=processes,
            origin=origin,
            programs=hash_programs(scenario.participants, directory),
        )
        report(RunStatus(state="starting", run_dir=run_dir.path))
        mark_used(environment_dir)
        for folder in later_rooms.values():
            mark_used(folder)
        with CompilationReporter(report) as reporter:
            flown = fly_it(setup, reporter)
        if reporter.has_compiled:
            keep_within_limit()
        return flown

    with StatusServer(run_dir, scenario, processes, report) as window:
        outcome = _execute_or_fault(lambda: outcome_of_flight(window))
    outcome.preparation_s = preparation_s
    _repair_recording(run_dir, outcome, scenario)
    _save_digest(run_dir, outcome)
    result = _save_result(run_dir, outcome, scenario, environments, began)
    report(RunStatus(state="ended", sim_time_s=result["sim_time_s"], real_time_factor=result["real_time_factor"]))
    return outcome, RunResult(exit_code=int(outcome.exit_code), run_dir=run_dir.path, result=result)


def _build_progress_handler(report: StatusHandler) -> "Progress":
    return lambda text, fraction: report(RunStatus(state="preparing", text=text, fraction=fraction))


def _execute(
    setup: RunSetup,
    directory: Path,
    network: Network,
    report: StatusHandler,
    groups: Sequence[ServiceGroup] | None,
    fork_server: ForkServer | None,
) -> RunOutcome:
    if groups is None:
        from gslcosim.runtime.in_process import run_in_process

        return run_in_process(setup, directory, network, report)
    return run_distributed(setup, directory, network, report, groups, fork_server)


# Whatever ends a run that has a directory is in its result: what was wrong, what the machine refused, and our bugs.
def _execute_or_fault(fly_it: Callable[[], RunOutcome]) -> RunOutcome:
    try:
        outcome = fly_it()
    except KeyboardInterrupt:
        # Before or after the part that ends in order by itself.
        return RunOutcome(is_interrupted=True)
    except Exception as error:
        if is_asked_to_end():
            return RunOutcome(is_interrupted=True)
        text = format_fault(error, traceback.format_exc())
        return RunOutcome(fault=ServiceFault(participant="supervisor", tick=0, text=text))
    outcome.require_reason()
    return outcome


def _save_digest(run_dir: RunDir, outcome: RunOutcome) -> None:
    if outcome.digest is None:
        return
    try:
        outcome.digest.save(run_dir.digest)
    except MachineError as error:
        _add_fault(outcome, str(error))


def _save_result(
    run_dir: RunDir, outcome: RunOutcome, scenario: Scenario, environments: Sequence[Path], began: float
) -> dict[str, Any]:
    manifest = _read_manifest(run_dir)

    def result() -> dict[str, Any]:
        return outcome.as_result(
            scenario,
            run_id=run_dir.run_id,
            wall_s=time.perf_counter() - began,
            validity=outcome.assess(scenario, environments, manifest),
        )

    try:
        run_dir.save_result(saved := result())
    except MachineError as error:
        _add_fault(outcome, str(error))
        return result()
    return saved


# A run that failed early has none.
def _read_manifest(run_dir: RunDir) -> RunManifest | None:
    try:
        return run_dir.load_manifest()
    except MalformedFileError:
        return None


def _add_fault(outcome: RunOutcome, text: str) -> None:
    if outcome.fault is None:
        outcome.fault = ServiceFault(participant="supervisor", tick=outcome.ticks_flown, text=text)
    elif text not in outcome.fault.text:
        outcome.fault = replace(outcome.fault, text=f"{outcome.fault.text}\n{text}")


def _repair_recording(run_dir: RunDir, outcome: RunOutcome, scenario: Scenario) -> None:
    if outcome.is_valid or not run_dir.recording.exists():
        return
    if run_dir.recording.stat().st_size == 0:
        run_dir.recording.unlink()
        return
    try:
        for kind in list_services(scenario):
            if kind.repair is not None:
                kind.repair(run_dir.recording)
    except (RecordingError, OSError) as error:
        # The recorder had not come as far as its first bytes; that must not hide what ended the run.
        _add_fault(outcome, f"The recording was not made whole: {format_fault(error, '')}")
