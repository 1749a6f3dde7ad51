"""What a fork at minute 5 costs with a snapshot and without, and what snapshots cost the run, in turns."""

import argparse
import contextlib
import io
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

from gslcosim.cli.main import main

AT_S = 300
RATE = 400
# Nobody comes that near, so that all runs last as long.
HEAVY = (
    "referee.success.within_m=0.02", f"gas.sources[0].filaments_per_s={RATE}", "agents[0].start.python=dung_beetle",
    f"referee.stop.time_limit_s={AT_S + 2}", "recording.enabled=false", "agents[0].parameters={}",
)  # fmt: skip


def _call(*words: str) -> tuple[dict, float]:
    output, began_s = io.StringIO(), time.process_time()
    with contextlib.redirect_stdout(output):
        code = main([*words, "--json", "--in-process"])
    assert code in (0, 1), output.getvalue()
    return json.loads(output.getvalue()), time.process_time() - began_s


def bench(scenario: str, n_rounds: int) -> None:
    """Fly, fork with and without a snapshot, and print CPU seconds."""
    settings = [word for value in HEAVY for word in ("--set", value)]
    plain_s, kept_s, from_start_s, from_snapshot_s = [], [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for i in range(n_rounds):
            place = Path(folder) / str(i)
            plain, taken_s = _call("up", scenario, *settings, "--runs-dir", str(place / "plain"))
            plain_s.append(taken_s)
            run, taken_s = _call("up", scenario, *settings, "--set", "snapshots={}", "--runs-dir", str(place / "kept"))
            kept_s.append(taken_s)
            words = ("fork", str(place / "kept" / run["run_id"]), "--at", str(AT_S), "--runs-dir", str(place / "forks"))
            whole, taken_s = _call(*words, "--from-start")
            from_start_s.append(taken_s)
            fork, taken_s = _call(*words)
            from_snapshot_s.append(taken_s)
            assert len({each["digest"] for each in (plain, run, whole, fork)}) == 1
        snapshots = place / "kept" / run["run_id"] / "snapshots"
        n_bytes = sum(file.stat().st_size for file in snapshots.rglob("*") if file.is_file())
    cost = statistics.median(b / a for a, b in zip(plain_s, kept_s, strict=True))
    gain = statistics.median(a / b for a, b in zip(from_start_s, from_snapshot_s, strict=True))
    lines = (
        f"{scenario} for {AT_S + 2} s with {RATE} filaments a second; CPU seconds, best of {n_rounds}",
        f"  flown without snapshots {min(plain_s):8.2f}",
        f"  flown with one each 60 s{min(kept_s):8.2f}   {cost:.2f} times; {n_bytes / 1e6:.1f} MB in its folder",
        f"  fork at {AT_S} s, from the start   {min(from_start_s):8.2f}",
        f"  fork at {AT_S} s, from the snapshot{min(from_snapshot_s):8.2f}   {gain:.1f} times as fast",
    )
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="warehouse_racks")
    parser.add_argument("--rounds", type=int, default=2)
    chosen = parser.parse_args()
    bench(chosen.scenario, chosen.rounds)
