"""One trial run in this process, from its plain data to its row and tracks, and what is prepared for all trials."""

import base64
import json
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.base.errors import GslCosimError
from gslcosim.base.files import ScratchFolder
from gslcosim.environment.generation.cache import prepare_environment, prepare_variants, with_variants
from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.store import load_environment
from gslcosim.runtime.in_process import run_in_process
from gslcosim.runtime.kernel_compilation import compile_agent_kernels
from gslcosim.runtime.network import Network
from gslcosim.runtime.outcome import RunOutcome, ServiceFault
from gslcosim.runtime.processes.sandbox.selection import describe_sandboxes
from gslcosim.runtime.run import run_scenario
from gslcosim.runtime.run_dir import RunDir
from gslcosim.runtime.setup import RunSetup
from gslcosim.runtime.status import RunResult
from gslcosim.scenario import Scenario
from gslcosim.scenario.loader import LoadedScenario
from gslcosim.validity.conduct import GAS_CONTACT_PPM
from gslcosim_bench.cases.models import Trial
from gslcosim_bench.execution.scoring import Row, SeriesCollector, build_row, build_tracks, build_validity_figures
from gslcosim_bench.store import pack_tracks
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import PointGrid, wind_m_s_at
from gslcosim_services.fields.gas_setup import gas_seed, gas_timing

Progress = Callable[[str, float], None]
# A map is the mean of so many moments, spread evenly over the time limit, seen as recorded slices are.
N_MOMENTS = 60
# What a map of a scenario holds for where its cases do not differ in what it shows, as JSON.
ALL_CASES = "{}"
CUTOFF_SIGMA = 3.0
# Cells of a map along its longer side, at most.
MAX_CELLS = 80
# Trials come in random order. Rooms are mapped files, so that one more costs little.
_ROOMS_KEPT = 8


def prepare_room(trial: Trial, progress: Progress) -> Path:
    """Return the folder of a trial's room, made now if it was not made before."""

    def report_progress(text: str, fraction: float | None) -> None:
        progress(text, fraction or 0.0)

    return prepare_environment(trial.resolved, scenario_dir=trial.directory, progress=report_progress).resolve()


def record_tape(trial: Trial, environment_dir: Path) -> None:
    """See that the gas of a trial is on tape."""
    scenario = trial.resolved
    field = build_gas_field(scenario, load_environment(environment_dir))
    field.reset(gas_seed(scenario, scenario.seed))


def build_map(trial: Trial, environment_dir: Path, *, varied: str) -> dict[str, Any]:
    """Return the map of a trial's room and gas at its search height, as `maps.json` has it.

    Gas is the mean over the time limit, and how often there is enough for the weakest sensor; wind is the mean of the
    unit vectors to which it blows.

    Args:
        trial: One with gas; its tape is recorded now if there is none.
        varied: What of the case the map holds for, as JSON; `{}`: for all of the scenario.
    """
    scenario, environment = trial.resolved, load_environment(environment_dir)
    grid = environment.grid
    height_m = scenario.agents[0].vehicle.search_height_m
    step = max(1, -(-max(grid.shape[:2]) // MAX_CELLS))
    layer = int(np.clip((height_m - grid.origin_m[2]) / grid.cell_m, 0, grid.shape[2] - 1))
    occupied = np.asarray(environment.occupancy[:, :, layer] == Cell.SOLID)[::step, ::step]
    cell_m = grid.cell_m * step
    first_m = (grid.origin_m[0] + 0.5 * grid.cell_m, grid.origin_m[1] + 0.5 * grid.cell_m, height_m)
    points = PointGrid(first_m=first_m, spacing_m=cell_m, shape=(*occupied.shape, 1))
    mean_ppm, intermittency, toward = _air_on(scenario, environment, points)
    return {
        "scenario": trial.scenario,
        "varied": varied,
        "environment_hash": environment.content_hash,
        "height_m": height_m,
        "origin_m": [float(grid.origin_m[0]), float(grid.origin_m[1])],
        "cell_m": cell_m,
        "shape": list(occupied.shape),
        "occupied": _text(occupied.astype(np.uint8)),
        "mean_gas_ppm": _text(mean_ppm.astype("<f4")),
        "intermittency": _text(intermittency.astype("<f4")),
        "wind_toward": _text(toward.astype("<f4")),
        "sources_m": [list(source.position_m) for source in scenario.gas.sources],
    }


def _air_on(
    scenario: Scenario, environment: Environment, points: PointGrid
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    field, timing = build_gas_field(scenario, environment), gas_timing(scenario)
    field.reset(gas_seed(scenario, scenario.seed))
    field.advance(timing.warm_up_steps)
    n_ticks = round(scenario.referee.stop.time_limit_s * 1000 / scenario.tick_ms)
    stride_ticks = max(1, n_ticks // N_MOMENTS // timing.ticks_per_step) * timing.ticks_per_step
    total_ppm, share, n = np.zeros(points.shape[:2]), np.zeros(points.shape[:2]), 0
    places_m, toward = points.points_m(), np.zeros((*points.shape[:2], 2))
    for _ in range(0, n_ticks, stride_ticks):
        field.advance(stride_ticks // timing.ticks_per_step * timing.steps_per_tick)
        ppm = field.mixing_ratio_ppm_on_grid(points, cutoff_sigma=CUTOFF_SIGMA)[:, :, 0]
        total_ppm += ppm
        share += ppm > GAS_CONTACT_PPM
        wind_m_s = wind_m_s_at(field, environment, places_m, field.step * timing.step_s)[:, :2]
        speed_m_s = np.hypot(*wind_m_s.T)
        toward += (wind_m_s / np.where(speed_m_s > 0.0, speed_m_s, 1.0)[:, None]).reshape(toward.shape)
        n += 1
    return total_ppm / n, share / n, toward / n


def _text(values: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


def map_keys(trials: Sequence[Trial]) -> list[tuple[Trial, str]]:
    """Return a trial for each map that the report needs, and what of its case the map holds for.

    A scenario has one map where its room, sources and height are the same in all its cases, otherwise one a case.
    """
    by_scenario: dict[str, dict[str, Trial]] = {}
    for trial in trials:
        if not trial.is_control:
            by_scenario.setdefault(trial.scenario, {}).setdefault(trial.varied, trial)
    keys: list[tuple[Trial, str]] = []
    for by_case in by_scenario.values():
        shown = {varied: _what_a_map_shows(trial) for varied, trial in by_case.items()}
        if len(set(shown.values())) == 1:
            keys.append((next(iter(by_case.values())), ALL_CASES))
        else:
            keys += [(trial, varied) for varied, trial in by_case.items()]
    return keys


def _what_a_map_shows(trial: Trial) -> str:
    scenario = trial.resolved
    gas = scenario.gas.model_dump_json(exclude={"seed"})
    return json.dumps([trial.room, gas, scenario.agents[0].vehicle.search_height_m])


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
    """Run a trial."""
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
    row |= build_validity_figures(outcome.assess(scenario, [environment_dir, *later_rooms.values()]))
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
    """Run a trial with a recording and leave a run directory of its own."""
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
