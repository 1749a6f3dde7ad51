"""One flight from a loaded scenario to a run directory: the runtime's front door."""

import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gslcosim.disk_cache import keep_within_limit, mark_used
from gslcosim.environment.store import load_environment
from gslcosim.errors import MachineError, RecordingError, UsageError
from gslcosim.generation import prepare_environment
from gslcosim.generation.later_rooms import prepare_later_rooms, with_later_rooms
from gslcosim.interruption import is_asked_to_end
from gslcosim.machine import fault_text
from gslcosim.runtime.agents.kernel_warmup import compile_agent_kernels
from gslcosim.runtime.agents.past import Past
from gslcosim.runtime.assembly import dataflow_of, service_names
from gslcosim.runtime.foreign.program_hashes import program_hashes
from gslcosim.runtime.grouping import Group, groups_of
from gslcosim.runtime.joining import Network
from gslcosim.runtime.kernel_compilation import CompilationReporter
from gslcosim.runtime.machine_notes import MachineLog
from gslcosim.runtime.outcome import Outcome, ServiceFault
from gslcosim.runtime.over_bus.forks import ForkServer
from gslcosim.runtime.over_bus.launch import fly_over_bus
from gslcosim.runtime.participants import services_of
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.sandbox.choosing import sandboxes_of
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.snapshots.shelf import Snapshot
from gslcosim.runtime.status import FlightResult, FlightStatus
from gslcosim.runtime.watching.window import FlightWindow
from gslcosim.scenario import Scenario
from gslcosim.scenario.loading import LoadedScenario, dump_resolved
from gslcosim.scenario.models.scenario import Processes

if TYPE_CHECKING:
    from gslcosim.generation.winds import Progress

Report = Callable[[FlightStatus], None]


@dataclass(frozen=True, kw_only=True)
class Repetition:
    """What a flight takes over from a run: its room, the commands of its past, and what the manifest says of it.

    `snapshot` is where it goes on; absent: it begins at tick 0.
    """

    environment_dir: Path
    past: Past
    origin: Mapping[str, Any]
    snapshot: Snapshot | None = None


def fly(
    loaded: LoadedScenario,
    *,
    runs_dir: Path,
    processes: Processes | None = None,
    network: Network | None = None,
    fork_server: ForkServer | None = None,
    report: Report = lambda _: None,
    repetition: Repetition | None = None,
) -> FlightResult:
    """Fly a scenario and leave a run directory, whatever happens in between.

    Args:
        loaded: The scenario and where it came from.
        runs_dir: Where the run directory is made.
        processes: How the run is spread over processes; absent: as the scenario says.
        network: How processes reach the run's router; ignored in one process.
        fork_server: Forks the services; absent: one is started where it is needed.
        report: Is told how preparation and flight go.
        repetition: What is taken over from another run; absent: nothing.

    Raises:
        GslCosimError: the scenario cannot be flown at all (its environment or dataflow is wrong).
        MachineError: no run directory can be made.
    """
    began = time.perf_counter()
    scenario = loaded.scenario
    network = network or Network()
    services = service_names(scenario)
    dataflow_of(scenario)
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
    started_here = [name for name in services if not network.is_elsewhere(name)]
    groups = groups_of(processes, started_here) if started_here else ()
    groups = (*groups, *((name,) for name in services if network.is_elsewhere(name)))
    sandboxes = sandboxes_of(scenario, is_one_process=processes == "one")
    if repetition is not None:
        environment_dir = repetition.environment_dir
    else:
        ahead = None if processes == "one" else fork_server
        environment_dir = _prepared_environment(loaded, report, ahead)
    compile_agent_kernels(
        scenario,
        loaded.directory,
        is_one_process=processes == "one",
        notify=lambda name: _telling(report)(f"compiling kernels of {name}", 0.0),
    )

    def fly_it(setup: Setup, report: Report) -> Outcome:
        setup = replace(setup, past=repetition and repetition.past)
        if scenario.recording.enabled:
            machine = MachineLog(setup.run_dir.path)
            machine.confined(sandboxes)
            machine.close()
        flown = _flown(setup, loaded.directory, network, report, None if processes == "one" else groups, fork_server)
        return replace(flown, sandboxes=sandboxes)

    _, result = fly_into_folder(
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


# Where nothing was made before, kernels are compiled for longer than a wind is solved: the other core has time.
def _prepared_environment(loaded: LoadedScenario, report: Report, fork_server: ForkServer | None) -> Path:
    rehearsing = fork_server

    def progress(text: str, fraction: float) -> None:
        nonlocal rehearsing
        if rehearsing is not None:
            rehearsing.rehearse(loaded.scenario, loaded.directory)
            rehearsing = None
        report(FlightStatus(state="preparing", text=text, fraction=fraction))

    return prepare_environment(loaded.scenario, scenario_dir=loaded.directory, progress=progress)


def fly_into_folder(
    scenario: Scenario,
    environment_dir: Path,
    fly_it: Callable[[Setup, Report], Outcome],
    *,
    runs_dir: Path,
    processes: Processes,
    began: float,
    report: Report,
    directory: Path,
    origin: Mapping[str, Any] | None = None,
    paced_from_tick: int | None = None,
    snapshot: Snapshot | None = None,
    sources: tuple[Path, ...] = (),
) -> tuple[Outcome, FlightResult]:
    """Make the folder of a run with all that decides its result, fly, and write what has come of it, whatever it is.

    Args:
        scenario: What is flown.
        environment_dir: Where its room is.
        fly_it: Flies, and tells how that goes to the report that it is given.
        runs_dir: Where the folder is made.
        processes: How the run is spread over processes.
        began: When it began, by `time.perf_counter` [s].
        report: Is told how the flight goes.
        directory: Where relative paths of agents start.
        origin: What the manifest says of the run that is flown again.
        paced_from_tick: The first tick that keeps the scenario's pace; absent: none.
        snapshot: Where it goes on; absent: it begins at tick 0.
        sources: The files from which the scenario was resolved.

    Raises:
        MachineError: the folder cannot be made.
    """
    run_dir = RunDir.create(runs_dir, name=scenario.name, seed=scenario.seed)

    def outcome_of_flight(report: Report) -> Outcome:
        run_dir.replace(run_dir.scenario.name, dump_resolved(scenario))
        later_rooms = prepare_later_rooms(scenario, scenario_dir=directory, progress=_telling(report))
        setup = Setup(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir.resolve(),
            environment=with_later_rooms(load_environment(environment_dir), later_rooms),
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
            programs=program_hashes(scenario.participants, directory),
        )
        report(FlightStatus(state="starting", run_dir=run_dir.path))
        mark_used(environment_dir)
        for folder in later_rooms.values():
            mark_used(folder)
        with CompilationReporter(report) as reporter:
            flown = fly_it(setup, reporter)
        if reporter.has_compiled:
            keep_within_limit()
        return flown

    with FlightWindow(run_dir, scenario, processes, report) as window:
        outcome = _or_fault(lambda: outcome_of_flight(window))
    _repair(run_dir, outcome, scenario)
    _save_digest(run_dir, outcome)
    result = _saved_result(run_dir, outcome, scenario, began)
    report(FlightStatus(state="ended", sim_time_s=result["sim_time_s"], real_time_factor=result["real_time_factor"]))
    return outcome, FlightResult(exit_code=int(outcome.exit_code), run_dir=run_dir.path, result=result)


def _telling(report: Report) -> "Progress":
    return lambda text, fraction: report(FlightStatus(state="preparing", text=text, fraction=fraction))


def _flown(
    setup: Setup,
    directory: Path,
    network: Network,
    report: Report,
    groups: Sequence[Group] | None,
    fork_server: ForkServer | None,
) -> Outcome:
    if groups is None:
        from gslcosim.runtime.in_process import fly_in_process

        return fly_in_process(setup, directory, network, report)
    return fly_over_bus(setup, directory, network, report, groups, fork_server)


# Whatever ends a run that has a directory is in its result: what was wrong, what the machine refused, and our bugs.
def _or_fault(fly_it: Callable[[], Outcome]) -> Outcome:
    try:
        return fly_it()
    except KeyboardInterrupt:
        # Before or after the part that ends in order by itself.
        return Outcome(is_interrupted=True)
    except Exception as error:
        if is_asked_to_end():
            return Outcome(is_interrupted=True)
        text = fault_text(error, traceback.format_exc())
        return Outcome(fault=ServiceFault(participant="supervisor", tick=0, text=text))


def _save_digest(run_dir: RunDir, outcome: Outcome) -> None:
    if outcome.digest is None:
        return
    try:
        outcome.digest.save(run_dir.digest)
    except MachineError as error:
        _add_fault(outcome, str(error))


def _saved_result(run_dir: RunDir, outcome: Outcome, scenario: Scenario, began: float) -> dict[str, Any]:
    def result() -> dict[str, Any]:
        return outcome.as_result(scenario, run_id=run_dir.run_id, wall_s=time.perf_counter() - began)

    try:
        run_dir.save_result(saved := result())
    except MachineError as error:
        _add_fault(outcome, str(error))
        return result()
    return saved


def _add_fault(outcome: Outcome, text: str) -> None:
    if outcome.fault is None:
        outcome.fault = ServiceFault(participant="supervisor", tick=outcome.ticks_flown, text=text)
    elif text not in outcome.fault.text:
        outcome.fault = replace(outcome.fault, text=f"{outcome.fault.text}\n{text}")


def _repair(run_dir: RunDir, outcome: Outcome, scenario: Scenario) -> None:
    if outcome.is_valid or not run_dir.recording.exists():
        return
    if run_dir.recording.stat().st_size == 0:
        run_dir.recording.unlink()
        return
    try:
        for kind in services_of(scenario):
            if kind.repair is not None:
                kind.repair(run_dir.recording)
    except (RecordingError, OSError) as error:
        # The recorder had not come as far as its first bytes; that must not hide what ended the run.
        _add_fault(outcome, f"The recording was not made whole: {fault_text(error, '')}")
