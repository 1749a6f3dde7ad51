"""How long `gslcosim runs` takes over thousands of run folders, beside reading their small files and nothing else."""

import argparse
import io
import json
import sys
import tempfile
import time
from contextlib import redirect_stderr, redirect_stdout
from operator import itemgetter
from pathlib import Path

from gslcosim.cli.main import main as gslcosim

TARGET_S = 2.0
N_TRIES = 3


def make_runs(example: Path, folder: Path, n: int) -> None:
    """Make `n` folders like a run's, each with its own seed, and with a recording of no size."""
    texts = {name: (example / name).read_text() for name in ("result.json", "manifest.json", "scenario.yaml")}
    texts |= {name: (example / name).read_text() for name in ("digest.json", "inputs.log", "setup.json")}
    end = (example / "recording.rrd").read_bytes()[-64:]
    result = json.loads(texts["result.json"])
    for i in range(n):
        run = folder / f"{example.name}-{i:05}"
        (run / "logs").mkdir(parents=True)
        result |= {"run_id": run.name, "seed": i, "end_reason": "success" if i % 3 else "collision"}
        for name, text in (texts | {"result.json": json.dumps(result)}).items():
            (run / name).write_text(text)
        (run / "recording.rrd").write_bytes(end)
        for part in ("world", "fields", "sensing", "referee", "recorder", "beetle"):
            (run / "logs" / f"{part}.log").write_text("")


def plain_reading(folder: Path) -> None:
    """Read the small files of each run."""
    for run in folder.iterdir():
        for name in ("result.json", "manifest.json", "scenario.yaml"):
            (run / name).read_bytes()


def timed(call) -> tuple[float, float]:
    """Return how long a call takes by the wall and of the processor [s]."""
    began_s, began_cpu_s = time.perf_counter(), time.process_time()
    call()
    return time.perf_counter() - began_s, time.process_time() - began_cpu_s


def main() -> None:
    """Print the times and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=5000, help="how many runs")
    n = parser.parse_args().n
    nowhere = io.StringIO()
    with tempfile.TemporaryDirectory() as scratch, redirect_stdout(nowhere), redirect_stderr(nowhere):
        flown, runs = Path(scratch) / "flown", Path(scratch) / "runs"
        if gslcosim(["up", "tiny_room", "--in-process", "--quiet", "--runs-dir", str(flown)]) not in (0, 1):
            raise SystemExit("The example did not fly.")
        make_runs(next(flown.iterdir()), runs, n)
        listing, reading = [], []
        for _ in range(N_TRIES):
            listing.append(timed(lambda: gslcosim(["runs", str(runs), "--where", "outcome=collision"])))
            reading.append(timed(lambda: plain_reading(runs)))
    (wall_s, cpu_s), (_, plain_cpu_s) = min(listing, key=itemgetter(1)), min(reading, key=itemgetter(1))
    sys.stdout.write(
        f"{n} runs listed in {wall_s:.2f} s, {cpu_s:.2f} s of CPU time: {cpu_s / plain_cpu_s:.1f} times reading three "
        f"files of each\n{'within' if cpu_s < TARGET_S else 'MISSES'} the target of {TARGET_S:g} s for 5000\n"
    )


if __name__ == "__main__":
    main()
