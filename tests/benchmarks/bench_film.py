"""How many frames of 1280 x 720 a film gets a second: drawn, and drawn and encoded, beside a plain loop of Python."""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import gslcosim_data
from gslcosim.cli.main import main as gslcosim_main
from gslcosim_data.film import FilmSegment, render_frames, write_film

SIZE_PX = (1280, 720)
ASKED_PER_S = 20
LOOP_STEPS = 1_000_000


def loop_s():
    """Return what a plain loop takes on this machine at this moment [s of CPU]."""
    began = time.process_time()
    total = 0
    for i in range(LOOP_STEPS):
        total += i
    return time.process_time() - began


def main():
    """Fly the quickstart for a minute, film it three times, and print the best."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200)
    n_frames = parser.parse_args().frames
    with tempfile.TemporaryDirectory() as folder:
        words = ["up", "warehouse_empty", "--in-process", "--quiet", "--runs-dir", folder]
        gslcosim_main([*words, "--set", "referee.stop.time_limit_s=60"])
        run = gslcosim_data.open_run(next(Path(folder).iterdir()))
        cut = FilmSegment.of(run, from_s=5, to_s=5 + n_frames / 25 * 4, speed=4)
        n = len(cut.times_s)
        drawn, filmed, loop = [], [], []
        for _ in range(3):
            loop.append(loop_s())
            began, cpu = time.perf_counter(), time.process_time()
            for _frame in render_frames([run], cut, SIZE_PX):
                pass
            drawn.append((n / (time.perf_counter() - began), (time.process_time() - cpu) / n))
            began, cpu = time.perf_counter(), time.process_time()
            write_film(render_frames([run], cut, SIZE_PX), Path(folder) / "film.mp4")
            filmed.append((n / (time.perf_counter() - began), (time.process_time() - cpu) / n))
    for name, rows in (("drawn", drawn), ("drawn and encoded as MP4", filmed)):
        per_s, cpu_s = max(row[0] for row in rows), min(row[1] for row in rows)
        ratio = cpu_s / (min(loop) / LOOP_STEPS) / 1000
        line = f"{name}: {per_s:.0f} frames/s, {1000 * cpu_s:.1f} ms of CPU a frame"
        sys.stdout.write(f"{line}, {ratio:.0f} thousand steps of a loop\n")
    loop_ms = 1000 * min(loop)
    sys.stdout.write(f"asked: {ASKED_PER_S} frames/s; a plain loop of {LOOP_STEPS} steps takes {loop_ms:.0f} ms\n")


if __name__ == "__main__":
    sys.exit(main())
