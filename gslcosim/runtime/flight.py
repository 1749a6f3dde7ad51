"""One flight from a loaded scenario to a run directory: the runtime's front door."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.errors import GslCosimError, RecordingError
from gslcosim.generation import prepare_environment
from gslcosim.runtime.assembly import dataflow_of, service_names
from gslcosim.runtime.grouping import Group, groups_of
from gslcosim.runtime.joining import Network
from gslcosim.runtime.outcome import Outcome, ServiceFault
from gslcosim.runtime.over_bus.forks import ForkServer
from gslcosim.runtime.over_bus.launch import fly_over_bus
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.status import FlightResult, FlightStatus
from gslcosim.scenario import Scenario
from gslcosim.scenario.loading import LoadedScenario, dump_resolved
from gslcosim.scenario.models.scenario import Processes


def fly(
    loaded: LoadedScenario,
    *,
    runs_dir: Path,
    processes: Processes | None = None,
    network: Network | None = None,
    fork_server: ForkServer | None = None,
    report: Callable[[FlightStatus], None] = lambda _: None,
) -> FlightResult:
    """Fly a scenario and leave a run directory, whatever happens in between.

    Args:
        loaded: The scenario and where it came from.
        runs_dir: Where the run directory is made.
        processes: How the run is spread over processes; absent: as the scenario says.
        network: How processes reach the run's router; ignored in one process.
        fork_server: Forks the services; absent: one is started where it is needed.
        report: Is told how preparation and flight go.

    Raises:
        GslCosimError: the scenario cannot be flown at all (its environment or dataflow is wrong).
    """
    began = time.perf_counter()
    scenario = loaded.scenario
    network = network or Network()
    network.check()
    dataflow_of(scenario)
    processes = scenario.processes if processes is None else processes
    groups = groups_of(processes, service_names(scenario))
    environment_dir = prepare_environment(
        scenario,
        scenario_dir=loaded.directory,
        progress=lambda text, fraction: report(FlightStatus(state="preparing", text=text, fraction=fraction)),
    )
    environment = load_environment(environment_dir)
    setup = begin(scenario, environment_dir.resolve(), environment, runs_dir=runs_dir, processes=processes)
    report(FlightStatus(state="starting"))
    outcome = _outcome(setup, loaded.directory, network, report, None if processes == "one" else groups, fork_server)
    return conclude(setup, outcome, began=began, report=report)


def begin(
    scenario: Scenario,
    environment_dir: Path,
    environment: Environment,
    *,
    runs_dir: Path,
    processes: Processes,
    origin: RunDir | None = None,
) -> Setup:
    """Make the folder of a run, with all that decides its result.

    Args:
        scenario: What is flown.
        environment_dir: Where its room is.
        environment: Its room.
        runs_dir: Where the folder is made.
        processes: How the run is spread over processes.
        origin: The run that is flown again.
    """
    run_dir = RunDir.create(runs_dir, name=scenario.name, seed=scenario.seed)
    run_dir.scenario.write_text(dump_resolved(scenario))
    setup = Setup(run_dir=run_dir, scenario=scenario, environment_dir=environment_dir, environment=environment)
    setup.save()
    run_dir.save_manifest(
        seed=scenario.seed,
        environment_hash=environment.content_hash,
        processes=processes,
        replay_of=None if origin is None else origin.run_id,
    )
    return setup


def conclude(setup: Setup, outcome: Outcome, *, began: float, report: Callable[[FlightStatus], None]) -> FlightResult:
    """Write what a flight has come to into its folder.

    Args:
        setup: The run.
        outcome: What it has come to.
        began: When it began, by `time.perf_counter` [s].
        report: Is told that it has ended.
    """
    run_dir, scenario = setup.run_dir, setup.scenario
    _repair(run_dir, outcome)
    if outcome.digest is not None:
        outcome.digest.save(run_dir.digest)
    result = outcome.as_result(scenario, run_id=run_dir.run_id, wall_s=time.perf_counter() - began)
    run_dir.save_result(result)
    report(FlightStatus(state="ended", sim_time_s=result["sim_time_s"], real_time_factor=result["real_time_factor"]))
    return FlightResult(exit_code=int(outcome.exit_code), run_dir=run_dir.path, result=result)


def _outcome(
    setup: Setup,
    directory: Path,
    network: Network,
    report: Callable[[FlightStatus], None],
    groups: Sequence[Group] | None,
    fork_server: ForkServer | None,
) -> Outcome:
    try:
        if groups is None:
            from gslcosim.runtime.in_process import fly_in_process

            return fly_in_process(setup, directory, network, report)
        return fly_over_bus(setup, directory, network, report, groups, fork_server)
    except GslCosimError as error:
        return Outcome(fault=ServiceFault(participant="supervisor", tick=0, text=str(error)))


def _repair(run_dir: RunDir, outcome: Outcome) -> None:
    if outcome.is_valid or not run_dir.recording.exists():
        return
    from gslcosim.recording.repair import repair_recording

    try:
        repair_recording(run_dir.recording)
    except RecordingError as error:
        # The recorder had not come as far as its first bytes; that must not hide what ended the run.
        note = f"The recording cannot be read: {error}"
        if outcome.fault is not None:
            outcome.fault = replace(outcome.fault, text=f"{outcome.fault.text}\n{note}")
