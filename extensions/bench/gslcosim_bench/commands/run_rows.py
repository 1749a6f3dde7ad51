"""Trials of results as rows of `gslcosim runs`."""

from pathlib import Path
from typing import Any

from gslcosim.base.errors import UsageError
from gslcosim.cli.commands.runs import RowReader
from gslcosim.recordings.run_summary import RunSummary

# Any of these files makes a folder one of results.
_TABLES = ("trials.parquet", "rows.jsonl")


def is_results_folder(folder: Path) -> bool:
    """Return whether a folder is one of results of the benchmark."""
    return (folder / "manifest.json").is_file() and any((folder / name).is_file() for name in _TABLES)


def _read_trials(folder: Path) -> list[RunSummary]:
    from gslcosim_bench.results import Results

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


ROWS = RowReader(is_own=is_results_folder, read=_read_trials)
