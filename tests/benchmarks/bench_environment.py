"""How long a whole warehouse environment takes: layout, occupancy, 5 s of wind, scene, picture. `make bench` runs it.

AutoGDM+ takes 90 s for one on 8 cores (thesis, section IV.A).
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

from gslcosim.environment.generation.builder import generate_environment
from gslcosim.scenario import load_scenario

N_RUNS = 3
TO_REACH_S = 8.0


def main():
    with tempfile.TemporaryDirectory() as folder:
        for name in ("gsl_bench_1", "gsl_bench_3", "gsl_bench_6"):
            scenario = load_scenario(name).scenario
            durations_s = []
            # The first also compiles, or reads what was compiled before.
            for _ in range(N_RUNS + 1):
                started_s = time.perf_counter()
                generate_environment(scenario.environment, scenario.wind, Path(folder) / name)
                durations_s.append(time.perf_counter() - started_s)
            best_s, median_s = min(durations_s[1:]), statistics.median(durations_s[1:])
            sys.stdout.write(f"{name}: {best_s:.1f} s at best, {median_s:.1f} s median (to reach: {TO_REACH_S:g} s)\n")


if __name__ == "__main__":
    main()
