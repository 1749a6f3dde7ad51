"""Print how many ticks per second gslcosim, HELICS and mosaik pass round five trivial participants, in turns.

Each participant is a process of its own and says 200 bytes at each tick to the next one. In the closed loop every tick
waits for the agent, the last of the five, whom the first one reads; in the open one participants may run ahead. All
start again for each figure; starting is left out. gslcosim checks, encodes and digests each message, the others carry
text as it is. Ratios are medians over the rounds, since only figures of one round have met the same machine.

    make bench-peers
    python tests/benchmarks/bench_peers.py --n 9 --ticks 5000 --json
    python tests/benchmarks/bench_peers.py --only gslcosim helics-ipc
"""

import argparse
import contextlib
import json
import os
import signal
import statistics
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).resolve().parent / "peers"
PEERS_PYTHON = ROOT / ".venv-peers" / "bin" / "python"
SHAPES = ("closed", "open")
# Even a peer at a hundredth of the usual speed is done by then.
LIMIT_S = 600.0
OWN = "gslcosim"

Speeds = Mapping[tuple[str, str], Sequence[float]]
"""Ticks per second of each round, by contestant and shape."""


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """A framework over one transport."""

    name: str
    title: str
    family: str
    words: tuple[str, ...]

    def command(self, peers_python: Path, shape: str, n_ticks: int) -> list[str]:
        """Return the command that prints its speed."""
        python = Path(sys.executable) if self.family == OWN else peers_python
        script, *options = self.words
        return [str(python), str(FOLDER / script), *options, "--shape", shape, "--ticks", str(n_ticks)]


CONTESTANTS = (
    Contestant(name=OWN, title="gslcosim, Zenoh", family=OWN, words=("gslcosim_ring.py",)),
    *(
        Contestant(
            name=f"helics-{core}", title=f"HELICS, {core}", family="HELICS", words=("helics_ring.py", "--core", core)
        )
        for core in ("zmq", "tcp", "ipc")
    ),
    Contestant(name="mosaik", title="mosaik", family="mosaik", words=("mosaik_ring.py",)),
)


def measured(
    contestant: Contestant, peers_python: Path, shape: str, n_ticks: int, *, limit_s: float = LIMIT_S
) -> float:
    """Return the ticks per second of one run of a contestant; no process of it is left afterwards."""
    command = contestant.command(peers_python, shape, n_ticks)
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            output, errors = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            sys.exit(f"{contestant.title}, {shape} loop: expected an end within {limit_s:g} s, was none.")
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    if process.returncode:
        sys.exit(f"{contestant.title}, {shape} loop: expected a speed, was:\n{errors}")
    return float(json.loads(output)["ticks_per_s"])


def in_turns(
    contestants: Sequence[Contestant], peers_python: Path, *, n_rounds: int, n_ticks: int
) -> dict[tuple[str, str], list[float]]:
    """Return the speeds of all rounds; every second round goes backwards, so that nobody is always after the same."""
    speeds: dict[tuple[str, str], list[float]] = {}
    for i in range(n_rounds):
        for shape in SHAPES:
            for contestant in contestants[:: -1 if i % 2 else 1]:
                speed = measured(contestant, peers_python, shape, n_ticks)
                speeds.setdefault((contestant.name, shape), []).append(speed)
    return speeds


def best_of(family: str, shape: str, speeds: Speeds) -> str | None:
    """Return who of a family has the best median in a shape, if any took part."""
    names = [c.name for c in CONTESTANTS if c.family == family and (c.name, shape) in speeds]
    return max(names, key=lambda name: statistics.median(speeds[name, shape]), default=None)


def ratios(family: str, shape: str, speeds: Speeds) -> tuple[str, list[float]] | None:
    """Return the best of a family and our speed over its speed in each round, if both took part."""
    best = best_of(family, shape, speeds)
    if best is None or (OWN, shape) not in speeds:
        return None
    return best, [own / peer for own, peer in zip(speeds[OWN, shape], speeds[best, shape], strict=True)]


def table(speeds: Speeds) -> str:
    """Return the table: medians of ticks per second, then our ratios with the lowest and the highest."""
    lines = [f"{'ticks/s':34}{'closed loop':>22}{'open loop':>22}"]
    for contestant in CONTESTANTS:
        if (contestant.name, SHAPES[0]) in speeds:
            cells = (f"{statistics.median(speeds[contestant.name, shape]):22.0f}" for shape in SHAPES)
            lines.append(f"{contestant.title:34}{''.join(cells)}")
    for family in ("HELICS", "mosaik"):
        report = [ratios(family, shape, speeds) for shape in SHAPES]
        if all(report):
            lines.append(f"{f'gslcosim / the best of {family}':34}" + "".join(_ratio_text(*found) for found in report))
    return "\n".join(lines) + "\n"


def _ratio_text(best: str, values: list[float]) -> str:
    spread = f"{min(values):.2f}-{max(values):.2f}"
    core = best.partition("-")[2]
    return f"{f'{core} {statistics.median(values):.2f} ({spread})':>22}"


def as_json(speeds: Speeds) -> str:
    """Return all figures and ratios."""
    found = {(family, shape): ratios(family, shape, speeds) for family in ("HELICS", "mosaik") for shape in SHAPES}
    report = {
        "ticks_per_s": [{"name": name, "shape": shape, "rounds": rounds} for (name, shape), rounds in speeds.items()],
        "ratios": [
            {"peer": pair[0], "shape": shape, "median": statistics.median(pair[1]), "rounds": pair[1]}
            for (_, shape), pair in found.items()
            if pair
        ],
    }
    return json.dumps(report, indent=2) + "\n"


def chosen(names: Sequence[str], peers_python: Path) -> list[Contestant]:
    """Return the contestants of these names, all for none, after a look whether they can run."""
    contestants = [contestant for contestant in CONTESTANTS if not names or contestant.name in names]
    if any(contestant.family != OWN for contestant in contestants) and not peers_python.exists():
        sys.exit(
            "expected HELICS and mosaik in a virtual environment of their own, found none. `make bench-peers` makes "
            f"it; `--only {OWN}` needs none.\nFile: {peers_python}"
        )
    return contestants


def positive(text: str) -> int:
    """Return a count that an option names."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a whole number of at least 1, was {text!r}.")
    return int(text)


def main() -> None:
    """Measure all in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=positive, default=5, help="how many rounds (default 5, about a minute each)")
    parser.add_argument("--ticks", type=positive, default=2000, help="how many ticks a run has (default 2000)")
    parser.add_argument("--only", nargs="+", default=[], choices=[c.name for c in CONTESTANTS], help="fewer of them")
    parser.add_argument("--peers-python", type=Path, default=PEERS_PYTHON, help="the Python that has HELICS and mosaik")
    parser.add_argument("--json", action="store_true", help="print all figures of all rounds as JSON")
    options = parser.parse_args()
    contestants = chosen(options.only, options.peers_python)
    speeds = in_turns(contestants, options.peers_python, n_rounds=options.n, n_ticks=options.ticks)
    if options.json:
        sys.stdout.write(as_json(speeds))
        return
    sys.stdout.write(f"{os.cpu_count()} cores, medians of {options.n} rounds of {options.ticks} ticks in turns\n")
    sys.stdout.write(table(speeds))


if __name__ == "__main__":
    main()
