"""Time and disk of a fresh set-up for `make run`, at two commits in turns, and their ratios.

`python tests/benchmarks/bench_setup.py 8b797ff6 HEAD --n 3` clones each commit into a temporary folder, makes
`.venv/ready` there and measures `.venv`. Processor time tells more than wall time where packages come over a network.
"""

# ruff: noqa: T201 - this is a script

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIGURES = ("wall [s]", "processor [s]", "disk [MB]")


def measure_disk_mb(folder: Path) -> float:
    """Return the size of a folder's files, where a file with several names counts once."""
    sizes = {info.st_ino: info.st_size for path in folder.rglob("*") if (info := path.lstat())}
    return sum(sizes.values()) / 1e6


def set_up(commit: str) -> tuple[float, float, float]:
    """Return wall time, processor time and disk of a set-up in a fresh clone, as `FIGURES` names them."""
    with tempfile.TemporaryDirectory() as temporary:
        clone = Path(temporary) / "clone"
        subprocess.run(["git", "clone", "--quiet", "--no-checkout", ROOT, clone], check=True)
        subprocess.run(["git", "checkout", "--quiet", commit], cwd=clone, check=True)
        before, began_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(["make", "--silent", ".venv/ready"], cwd=clone, check=True, stdout=sys.stderr)
        wall_s, after = time.perf_counter() - began_s, resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return wall_s, cpu_s, measure_disk_mb(clone / ".venv")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", help="commit to compare with")
    parser.add_argument("commit", nargs="?", default="HEAD", help="commit that is compared; HEAD by default")
    parser.add_argument("--n", type=int, default=3, help="rounds of one set-up of each; 3 by default")
    options = parser.parse_args()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    rows = [(set_up(options.base), set_up(options.commit)) for _ in range(options.n)]
    print(f"{'':14} {options.base:>10} {options.commit:>10} {'ratio':>8}")
    for i, name in enumerate(FIGURES):
        base, new = (statistics.median(row[side][i] for row in rows) for side in (0, 1))
        print(f"{name:14} {base:10.1f} {new:10.1f} {new / base:8.2f}")


if __name__ == "__main__":
    main()
