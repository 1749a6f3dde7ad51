"""Medians of the table of speed by commit, a line of JSON each, and what is worse than in the last ones."""

import json
import statistics
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

HISTORY = Path(__file__).resolve().with_suffix(".jsonl")
N_COMPARED = 10
# Figures of one commit on one machine differ by as much.
TOLERANCE = 0.1
# Above this the scheduler is measured, not the code.
MAX_FOREIGN_CORES = 0.1


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What was measured at one commit: medians by the titles of their rows, and what else used the processors."""

    commit: str
    processor: str
    foreign_cores: float
    medians: dict[str, float]


def find_commit() -> str:
    """Return the checkout's commit, with a plus where files differ from it."""
    call = ["git", "describe", "--always", "--abbrev=8", "--exclude=*", "--dirty=+"]
    return subprocess.check_output(call, cwd=HISTORY.parent, text=True).strip()


def load_entries(path: Path = HISTORY) -> list[Entry]:
    """Return all entries, oldest first; none where there is no file."""
    lines = path.read_text().splitlines() if path.is_file() else []
    return [Entry(**json.loads(line)) for line in lines]


def save_entry(entry: Entry, path: Path = HISTORY) -> None:
    """Append an entry."""
    with path.open("a") as file:
        file.write(json.dumps(asdict(entry)) + "\n")


def find_regressions(medians: Mapping[str, float], bounds: Mapping[str, str], entries: Sequence[Entry]) -> list[str]:
    """Return a sentence for each figure that is worse than the median of the last entries of calm machines.

    Args:
        medians: Today's figures by title.
        bounds: By title, whether a figure is good `at least` or `at most` at its goal.
        entries: Those before, oldest first.
    """
    worse: list[str] = []
    for title, value in medians.items():
        calm = [entry for entry in entries if title in entry.medians and entry.foreign_cores <= MAX_FOREIGN_CORES]
        if not (last := calm[-N_COMPARED:]):
            continue
        usual = statistics.median(entry.medians[title] for entry in last)
        is_worse = value < usual * (1 - TOLERANCE) if bounds[title] == "at least" else value > usual * (1 + TOLERANCE)
        if is_worse:
            worse.append(
                f"{title}: expected {bounds[title]} about {usual:.3g}, as in {len(last)} before, was {value:.3g}"
            )
    return worse
