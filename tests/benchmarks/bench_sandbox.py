"""What a sandbox of its agent costs a run: speed and start with each sandbox over those without, in turns.

The quickstart as it is, without its recording.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from gslcosim.runtime.processes.sandbox.selection import unavailable_reason

FLIGHT = (sys.executable, "-m", "gslcosim", "up", "warehouse_empty", "--json", "--set", "recording.enabled=false")
ALL = ("none", "bubblewrap", "landlock")


def flown(folder: Path, sandbox: str, within_m: float) -> dict[str, float]:
    """Return the figures of one run."""
    settings = ("--set", f"agents[0].sandbox={sandbox}", "--set", f"referee.success.within_m={within_m}")
    ended = subprocess.run([*FLIGHT, "--runs-dir", str(folder), *settings], capture_output=True, text=True, check=False)
    result = json.loads(ended.stdout)
    assert result["valid"], (result["faults"], ended.stderr)
    return {key: float(result[key]) for key in ("real_time_factor", "start_up_s", "wall_time_s")}


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=5, metavar="N", help="flights of each kind (default: 5)")
    parser.add_argument(
        "--whole", action="store_true", help="fly to the time limit, not to the source: longer, and less noise"
    )
    arguments = parser.parse_args()
    kinds = [kind for kind in ALL if not unavailable_reason(kind)]
    figures: dict[str, list[dict[str, float]]] = {kind: [] for kind in kinds}
    with tempfile.TemporaryDirectory() as scratch:
        for i in range(arguments.n):
            # Each is the first as often as the others.
            for kind in kinds[i % len(kinds) :] + kinds[: i % len(kinds)]:
                figures[kind].append(flown(Path(scratch), kind, 0.001 if arguments.whole else 1.0))
    medians = {
        kind: {key: statistics.median(each[key] for each in figures[kind]) for key in figures[kind][0]}
        for kind in kinds
    }
    for kind in kinds[1:]:
        ratio = medians[kind]["real_time_factor"] / medians["none"]["real_time_factor"]
        later_s = medians[kind]["start_up_s"] - medians["none"]["start_up_s"]
        sys.stdout.write(f"{kind} / none, speed: {ratio:.2f} (1 within noise asked); start: {1000 * later_s:+.0f} ms\n")
    for kind in kinds:
        speeds = " ".join(f"{each['real_time_factor']:.0f}" for each in figures[kind])
        sys.stdout.write(f"{kind:10} {speeds} x real time\n")


if __name__ == "__main__":
    main()
