"""Many short flights on several cores, kept in a file of lines so that a study that was stopped goes on."""

import json
import sys
import tempfile
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from gslcosim.environment.random_places import draw_places
from gslcosim.runtime.flight import fly
from gslcosim.scenario import load_scenario

Row = dict[str, Any]
AnyTrial = TypeVar("AnyTrial")
N_BOOTSTRAP = 2000


def fly_missing(
    trials: Iterable[AnyTrial], fly_one: Callable[[AnyTrial], Row], *, n_jobs: int, path: Path
) -> dict[AnyTrial, Row]:
    """Fly the trials that the file does not have, append a line for each, and return the rows of all.

    Args:
        trials: Frozen dataclasses of plain values.
        fly_one: Flies one, in a process of its own.
        n_jobs: How many fly at a time.
        path: The file of lines.
    """
    trials = list(trials)
    rows = read_rows(path, type(trials[0])) if trials else {}
    missing = [trial for trial in trials if trial not in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(n_jobs) as pool, path.open("a") as file:
        futures = {pool.submit(fly_one, trial): trial for trial in missing}
        for n_done, future in enumerate(as_completed(futures), 1):
            trial, row = futures[future], future.result()
            rows[trial] = row
            file.write(json.dumps({"trial": asdict(trial), **row}) + "\n")  # type: ignore[call-overload]
            file.flush()
            if sys.stderr.isatty():
                sys.stderr.write(f"\r{n_done} of {len(missing)} flights")
    return rows


def read_rows(path: Path, trial_type: type[AnyTrial]) -> dict[AnyTrial, Row]:
    """Return what has been flown; a line that was cut off is left out."""
    rows: dict[AnyTrial, Row] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows[trial_type(**row.pop("trial"))] = row
    return rows


def fly_fields(fields: dict[str, Any], *, seed: int) -> Row:
    """Fly a scenario of plain values in this process, unrecorded; return who found what, when, and the faults.

    `time_s` is the first agent's that succeeded, the time limit where none did.

    Raises:
        SystemExit: the run is not valid, with the reason.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.yaml"
        path.write_text(yaml.safe_dump(fields, sort_keys=False))
        loaded = load_scenario(path, seed=seed, placer=draw_places)
        result = fly(loaded, runs_dir=Path(folder), in_process=True).result
    if not result["valid"]:
        raise SystemExit(f"{fields['name']}, seed {seed}: {'; '.join(fault['text'] for fault in result['faults'])}")
    agents = result["agents"]
    times_s = [agent["time_to_source_s"] for agent in agents if agent["success"]]
    errors_m = [agent["declared_error_m"] for agent in agents if agent["declared_error_m"] is not None]
    return {
        "success": bool(times_s),
        "time_s": min(times_s, default=loaded.scenario.referee.stop.time_limit_s),
        "outcome": agents[0]["outcome"],
        "declared_error_m": min(errors_m, default=None),
        "belief": max((agent["belief"]["mass_near_frac"] for agent in agents if agent["belief"]), default=None),
        "faults": [fault["text"] for fault in result["faults"]],
    }


def mean_with_interval(values: Iterable[float]) -> tuple[float, float, float]:
    """Return the mean and the middle 95 % of the means over values drawn again, with replacement."""
    array = np.array(list(values), dtype=float)
    draws = np.random.default_rng(0).integers(len(array), size=(N_BOOTSTRAP, len(array)))
    low, high = np.percentile(array[draws].mean(axis=1), [2.5, 97.5])
    return float(array.mean()), float(low), float(high)


def interval_text(values: Iterable[float], *, signed: bool = True) -> str:
    """Return a mean with its interval, as a table has it."""
    mean, low, high = mean_with_interval(values)
    return f"{mean:+.0f} [{low:+.0f}, {high:+.0f}]" if signed else f"{mean:.0f} [{low:.0f}, {high:.0f}]"
