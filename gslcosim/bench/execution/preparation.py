"""Preparation shared by trials, made once before them: environments, gas tapes, and the maps of the report."""

import base64
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gslcosim.bench.cases.trials import Trial
from gslcosim.environment.generation import prepare_environment
from gslcosim.environment.model import Cell, Environment
from gslcosim.environment.store import load_environment
from gslcosim.scenario import Scenario
from gslcosim_services.fields.gas_builder import build_gas_field
from gslcosim_services.fields.gas_field import PointGrid, wind_m_s_at
from gslcosim_services.fields.gas_setup import gas_seed, gas_timing
from gslcosim_services.referee.agent_evaluation import GAS_CONTACT_PPM

Progress = Callable[[str, float], None]
# A map is the mean of so many moments, spread evenly over the time limit, seen as recorded slices are.
N_MOMENTS = 60
# What a map of a scenario holds for where its cases do not differ in what it shows, as JSON.
ALL_CASES = "{}"
CUTOFF_SIGMA = 3.0
# Cells of a map along its longer side, at most.
MAX_CELLS = 80


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
        environment_dir: The folder of its room.
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
