"""What a viewer beside a run costs it, where nobody looks closely: speed with `--serve` over speed without.

Runs in turns, the quickstart for its whole 300 s of simulated time.
"""

import argparse
import json
import signal
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

FLIGHT = (
    sys.executable, "-m", "gslcosim", "up", "warehouse_empty", "--json", "--set", "referee.success.within_m=0.001"
)  # fmt: skip


def speed(folder: Path, *arguments: str) -> float:
    """Return times real time of a run; a viewer is closed once it has been given everything."""
    call = [*FLIGHT, "--runs-dir", str(folder), *arguments]
    flight = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert flight.stdout is not None
    assert flight.stderr is not None
    for line in flight.stderr:
        if "stays open" in line:
            flight.send_signal(signal.SIGINT)
    result = json.loads(flight.stdout.read())
    flight.wait()
    return float(result["real_time_factor"])


def main() -> None:
    """Print the ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=3, metavar="N", help="flights of each kind (default: 3)")
    n_flights = parser.parse_args().n
    without: list[float] = []
    served: list[float] = []
    with tempfile.TemporaryDirectory() as scratch:
        for _ in range(n_flights):
            without.append(speed(Path(scratch)))
            served.append(speed(Path(scratch), "--serve"))
    ratio = statistics.median(served) / statistics.median(without)
    sys.stdout.write(f"with --serve / without, speed: {ratio:.2f} (at least 0.90 asked)\n")
    for name, speeds in (("without", without), ("with --serve", served)):
        sys.stdout.write(f"{name:14} {' '.join(f'{value:.0f}' for value in speeds)} x real time\n")


if __name__ == "__main__":
    main()
