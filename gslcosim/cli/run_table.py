"""Table of runs and of trials, one row each."""

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError
from gslcosim.base.os_errors import describe_os_error
from gslcosim.data.run_summary import RunSummary, is_run_folder, read_run_summary

COLUMNS = tuple(field.name for field in dataclasses.fields(RunSummary))
TEXTS = ("run", "folder", "state", "outcome", "scenario", "method", "version")
NUMBERS = tuple(name for name in COLUMNS if name not in TEXTS)
# As the headings of the table have them.
SHORT_NAMES = {"time": "time_s", "size": "size_mb", "age": "age_h"}
# Any of these files makes a folder one of results.
_TABLES = ("trials.parquet", "rows.jsonl")


def collect_rows(folders: Sequence[Path], tell: Callable[[int], None] | None = None) -> list[dict[str, Any]]:
    """Return the runs in some folders, and the trials of those that are results.

    Args:
        folders: Folders of runs, runs, or results.
        tell: Receives how many have been read, now and then.

    Raises:
        UsageError: a folder is none, or cannot be read.
    """
    facts: list[RunSummary] = []
    for folder in folders:
        if not folder.is_dir():
            raise UsageError(f"{folder}: expected a folder of runs, found none. Fly one: gslcosim up warehouse_empty")
        if is_results_folder(folder):
            facts += _trials_of(folder)
            continue
        for path in _folders_in(folder):
            facts.append(_facts_or_why_not(path))
            if tell is not None and len(facts) % 500 == 0:
                tell(len(facts))
    # Not `dataclasses.asdict`, which copies each value.
    rows = [{name: getattr(one, name) for name in COLUMNS} for one in facts]
    if any(row["state"] == "broken" for row in rows):
        _mark_running(rows)
    return rows


def is_results_folder(folder: Path) -> bool:
    """Return whether a folder is one of results of the benchmark."""
    return (folder / "manifest.json").is_file() and any((folder / name).is_file() for name in _TABLES)


def _folders_in(folder: Path) -> list[Path]:
    if is_run_folder(folder):
        return [folder]
    try:
        return sorted(path for path in folder.iterdir() if path.is_dir())
    except OSError as error:
        raise UsageError(
            f"{folder}: expected a folder of runs that can be read, was {describe_os_error(error)}."
        ) from error


# One folder that cannot be read, or is gone by now, is no reason to show none.
def _facts_or_why_not(path: Path) -> RunSummary:
    try:
        return read_run_summary(path)
    except OSError as error:
        return RunSummary(run=path.name, folder=str(path), state="foreign", outcome=describe_os_error(error))


# A run without a result is asked for at the windows of runs.
def _mark_running(rows: Sequence[dict[str, Any]]) -> None:
    from gslcosim.runtime.status import list_active_runs

    flights = {flight.facts["run_dir"]: flight.facts for flight in list_active_runs()}
    for row in rows:
        if row["state"] != "broken":
            continue
        flight = flights.get(str(Path(row["folder"]).resolve()))
        if flight is not None:
            row |= {
                "state": "running",
                "outcome": flight["state"],
                "time_s": flight["sim_time_s"],
                "speed": flight["real_time_factor"],
            }


def _trials_of(folder: Path) -> list[RunSummary]:
    from gslcosim.bench.results import Results

    try:
        results = Results.load(folder)
        version = str(results.manifest.get("versions", {}).get("gslcosim", ""))
    except UsageError as error:
        text = str(error).partition("\nFile: ")[0]
        return [RunSummary(run=folder.name, folder=str(folder), state="broken", outcome=text)]
    return [_trial(row, folder, version) for row in results.trials.to_pylist()]


def _trial(row: dict[str, Any], folder: Path, version: str) -> RunSummary:
    flew = row["status"] == "flown"
    end_s, flying_s = row["end_s"], row["wall_flying_s"]
    return RunSummary(
        run=row["trial"],
        folder=str(folder),
        state="ended" if flew else "broken",
        outcome=row["outcome"] if flew else row["status"],
        scenario=row["case"],
        method=row["entry"],
        seed=row["seed"],
        time_s=end_s,
        speed=round(end_s / flying_s, 1) if end_s and flying_s else None,
        faults=_n_sentences(row["agent_faults"]) + (1 if row["fault"] else 0),
        time_to_source_s=row["time_to_source_s"],
        distance_m=None,
        path_m=row["total_path_length_m"],
        agents=row["n_robots"],
        version=version,
    )


def _n_sentences(text: str | None) -> int:
    return len([line for line in (text or "").splitlines() if line.strip()])
