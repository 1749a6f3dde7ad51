"""Run paths as people name them: a folder, a file in it, the run's id, or nothing for the newest."""

import argparse
from pathlib import Path

from gslcosim.base.errors import UsageError

RUNS_DIR = "runs"
RECORDING = "recording.rrd"
DIGEST = "digest.json"
MANIFEST = "manifest.json"


def add_runs_dir_option(parser: argparse.ArgumentParser) -> None:
    """Add `--runs-dir`."""
    parser.add_argument(
        "--runs-dir", type=Path, default=Path(RUNS_DIR), metavar="DIR", help="the folder of all runs (default: runs)"
    )


def find_in_run(run: str | None, *, runs_dir: Path, file_name: str) -> Path:
    """Return a file of a run.

    Args:
        run: The run's folder, the file itself, the run's id under `runs_dir` or the beginning of it; None is the
            newest run that has the file.
        runs_dir: The folder of all runs.
        file_name: The file's name within a run.

    Raises:
        UsageError: there is no such run, several fit, or it has no such file.
    """
    if run is None:
        return _newest(runs_dir, file_name)
    path = Path(run)
    if path.is_file():
        return path
    folders = [path] if path.is_dir() else _that_begin_with(run, runs_dir)
    if len(folders) != 1:
        found = f"{len(folders)} that fit: {', '.join(p.name for p in folders[:5])}" if folders else "none"
        raise UsageError(f"{run}: expected a run's folder or the id of one run in {runs_dir}, found {found}.")
    file = folders[0] / file_name
    if not file.is_file():
        raise UsageError(f"{run}: expected a run with a {file_name}, found none. Has the run ended well?\nFile: {file}")
    return file


def _that_begin_with(run_id: str, runs_dir: Path) -> list[Path]:
    if not runs_dir.is_dir():
        return []
    return sorted(path for path in runs_dir.iterdir() if path.is_dir() and path.name.startswith(run_id))


def _newest(runs_dir: Path, file_name: str) -> Path:
    files = sorted(runs_dir.glob(f"*/{file_name}"), key=lambda path: path.stat().st_mtime_ns)
    if not files:
        raise UsageError(
            f"{runs_dir}: expected a run with a {file_name}, found none. Fly one: gslcosim up warehouse_empty"
        )
    return files[-1]
