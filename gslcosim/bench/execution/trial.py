"""One trial run in this process, from its plain data to its row and tracks."""

import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gslcosim.base.errors import GslCosimError
from gslcosim.base.scratch import ScratchFolder
from gslcosim.bench.cases.trials import Trial
from gslcosim.bench.execution.collector import SeriesCollector
from gslcosim.bench.execution.scoring import Row, build_row, build_tracks
from gslcosim.bench.store.columns import pack_tracks
from gslcosim.environment.generation.variants import prepare_variants, with_variants
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.agents.kernel_warmup import compile_agent_kernels
from gslcosim.runtime.in_process import run_in_process
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault
from gslcosim.runtime.processes.sandbox.selection import describe_sandboxes
from gslcosim.runtime.run import run_scenario
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult
from gslcosim.scenario.loader import LoadedScenario

# Rooms of a suite come one after the other.
_ROOMS_KEPT = 2


@dataclass(frozen=True, kw_only=True)
class TrialResult:
    """Result of a trial: its row without what the store adds, and its tracks, packed."""

    row: Row
    tracks: bytes | None


class EnvironmentCache:
    """Environments that this process has loaded, the last few of them."""

    def __init__(self) -> None:
        self._loaded: OrderedDict[Path, Environment] = OrderedDict()

    def load(self, folder: Path) -> Environment:
        """Return the environment of a folder."""
        if folder not in self._loaded:
            self._loaded[folder] = load_environment(folder)
            while len(self._loaded) > _ROOMS_KEPT:
                self._loaded.popitem(last=False)
        self._loaded.move_to_end(folder)
        return self._loaded[folder]


def run_trial(trial: Trial, environment_dir: Path, rooms: EnvironmentCache) -> TrialResult:
    """Run a trial.

    Args:
        trial: What to fly.
        environment_dir: The folder of its room.
        rooms: Those that are loaded.
    """
    began = time.perf_counter()
    scenario = trial.resolved
    later_rooms = prepare_variants(scenario, scenario_dir=trial.directory)
    environment = with_variants(rooms.load(environment_dir), later_rooms)
    compile_agent_kernels(scenario, trial.directory, is_one_process=True)
    watch = SeriesCollector(scenario)
    with _scratch_run_dir() as run_dir:
        setup = RunSetup(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir,
            environment=environment,
            sources=trial.sources,
        )
        prepared = time.perf_counter()
        outcome = _outcome(setup, trial.directory, watch)
        flown = time.perf_counter()
    row = build_row(trial, environment.content_hash, outcome, watch)
    judged = time.perf_counter()
    tracks = pack_tracks(build_tracks(watch))
    decisions_ms = np.asarray(outcome.decisions_s) * 1000.0
    row |= {
        "wall_decision_p50_ms": float(np.median(decisions_ms)) if len(decisions_ms) else None,
        "wall_decision_p95_ms": float(np.quantile(decisions_ms, 0.95)) if len(decisions_ms) else None,
        "wall_preparing_s": prepared - began,
        "wall_starting_s": flown - prepared - outcome.flight_wall_s,
        "wall_flying_s": outcome.flight_wall_s,
        "wall_judging_s": judged - flown,
        "wall_storing_s": time.perf_counter() - judged,
    }
    return TrialResult(row=row, tracks=tracks)


def record_trial(trial: Trial, runs_dir: Path) -> RunResult:
    """Run a trial with a recording and leave a run directory of its own.

    Args:
        trial: What to fly.
        runs_dir: Where the run directory is made.
    """
    scenario = trial.resolved
    scenario = scenario.model_copy(update={"recording": scenario.recording.model_copy(update={"enabled": True})})
    loaded = LoadedScenario(
        scenario=scenario,
        path=trial.directory / "suite",
        directory=trial.directory,
        text="",
        included=trial.sources,
    )
    return run_scenario(loaded, runs_dir=runs_dir, processes="one")


def _outcome(setup: RunSetup, directory: Path, watch: SeriesCollector) -> RunOutcome:
    try:
        sandboxes = describe_sandboxes(setup.scenario, is_one_process=True)
        outcome = run_in_process(setup, directory, Network(), lambda _: None, watch.note)
        return replace(outcome, sandboxes=sandboxes)
    except GslCosimError as error:
        return RunOutcome(fault=ServiceFault(participant="supervisor", tick=0, text=str(error)))


@contextmanager
def _scratch_run_dir() -> Iterator[RunDir]:
    with ScratchFolder("bench") as scratch:
        (scratch.path / "logs").mkdir()
        yield RunDir(scratch.path)
