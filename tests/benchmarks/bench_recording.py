"""What recording costs: microseconds per tick, on one core, of a run of 300 s with one agent; best of several runs.

Run `python tests/benchmarks/bench_recording.py`.
"""

import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/unit/services/recorder"), str(ROOT / "tests/kit")]

from built_rooms import build_air  # noqa: E402
from scripted_flight import ScriptedFlight  # noqa: E402

from gslcosim.contract.participant import Episode  # noqa: E402
from gslcosim_services.recorder.core import RecorderCore  # noqa: E402

N_TICKS = 3000
N_RUNS = 5


def record(n_filaments):
    """Record once; return microseconds of wall and of processor time per tick, close included, and the file's size."""
    flight = ScriptedFlight(n_ticks=N_TICKS, n_filaments=n_filaments)
    inboxes = [flight.inbox(tick) for tick in range(N_TICKS)]
    with tempfile.TemporaryDirectory() as folder:
        core = RecorderCore(
            flight.scenario, build_air((75, 75, 40), (0.2, 0.0, 0.0), cell_m=0.2), Path(folder) / "recording.rrd"
        )
        core.reset(Episode(seed=0))
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        for tick, inbox in enumerate(inboxes):
            core.step(tick, inbox)
        stepped_s = time.perf_counter() - wall_s
        core.close()
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        size = (Path(folder) / "recording.rrd").stat().st_size
    return stepped_s / N_TICKS * 1e6, wall_s / N_TICKS * 1e6, cpu_s / N_TICKS * 1e6, size


def main():
    """Print the figures."""
    head = ("filaments", "us/tick stepping", "us/tick with close", "us/tick, all threads", "MB in 300 s")
    print("".join(f"{column:>22}" for column in head))  # noqa: T201
    for n_filaments in (0, 1500, 3000, 60_000):
        runs = [record(n_filaments) for _ in range(N_RUNS)]
        stepping, wall, cpu, size = (min(figures) for figures in zip(*runs, strict=True))
        print(f"{n_filaments:22d}{stepping:22.1f}{wall:22.1f}{cpu:22.1f}{size / 1e6:22.1f}")  # noqa: T201


if __name__ == "__main__":
    main()
