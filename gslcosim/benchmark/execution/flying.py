"""One trial flown in this process, from its plain data to its row and tracks."""

import time
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gslcosim.benchmark.execution.judging import Row, row_of, tracks_of
from gslcosim.benchmark.execution.watching import Watch
from gslcosim.benchmark.store.tracks import packed
from gslcosim.benchmark.suite.trials import Trial
from gslcosim.environment.model import Environment
from gslcosim.environment.store import load_environment
from gslcosim.errors import GslCosimError
from gslcosim.generation.later_rooms import prepare_later_rooms, with_later_rooms
from gslcosim.runtime.agents.kernel_warmup import compile_agent_kernels
from gslcosim.runtime.flight import fly
from gslcosim.runtime.in_process import fly_in_process
from gslcosim.runtime.joining import Network
from gslcosim.runtime.outcome import Outcome, ServiceFault
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.sandbox.choosing import sandboxes_of
from gslcosim.runtime.setup import Setup
from gslcosim.runtime.status import FlightResult
from gslcosim.scenario.loading import LoadedScenario
from gslcosim.scratch import ScratchFolder

# Rooms of a suite come one after the other.
_ROOMS_KEPT = 2


@dataclass(frozen=True, kw_only=True)
class Flown:
    """What a trial brought in: its row without what the store adds, and its tracks, packed."""

    row: Row
    tracks: bytes | None


class Rooms:
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


def fly_trial(trial: Trial, environment_dir: Path, rooms: Rooms) -> Flown:
    """Fly a trial.

    Args:
        trial: What to fly.
        environment_dir: The folder of its room.
        rooms: Those that are loaded.
    """
    began = time.perf_counter()
    scenario = trial.resolved
    later_rooms = prepare_later_rooms(scenario, scenario_dir=trial.directory)
    environment = with_later_rooms(rooms.load(environment_dir), later_rooms)
    compile_agent_kernels(scenario, trial.directory, is_one_process=True)
    watch = Watch(scenario)
    with _scratch_run_dir() as run_dir:
        setup = Setup(
            run_dir=run_dir,
            scenario=scenario,
            environment_dir=environment_dir,
            environment=environment,
            sources=trial.sources,
        )
        prepared = time.perf_counter()
        outcome = _outcome(setup, trial.directory, watch)
        flown = time.perf_counter()
    row = row_of(trial, environment.content_hash, outcome, watch)
    judged = time.perf_counter()
    tracks = packed(tracks_of(watch))
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
    return Flown(row=row, tracks=tracks)


def record_trial(trial: Trial, runs_dir: Path) -> FlightResult:
    """Fly a trial with a recording and leave a run directory of its own.

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
    return fly(loaded, runs_dir=runs_dir, processes="one")


def _outcome(setup: Setup, directory: Path, watch: Watch) -> Outcome:
    try:
        sandboxes = sandboxes_of(setup.scenario, is_one_process=True)
        outcome = fly_in_process(setup, directory, Network(), lambda _: None, watch.note)
        return replace(outcome, sandboxes=sandboxes)
    except GslCosimError as error:
        return Outcome(fault=ServiceFault(participant="supervisor", tick=0, text=str(error)))


@contextmanager
def _scratch_run_dir() -> Iterator[RunDir]:
    with ScratchFolder("bench") as scratch:
        (scratch.path / "logs").mkdir()
        yield RunDir(scratch.path)
