"""Prints simulated robot-seconds per second of a processor of gslcosim's batches and of other simulators, in turns.

Each contestant is a process of its own, which builds its robots once and then steps them in each round; building and
compiling are left out. They simulate different things, as the last column says. Ratios are medians over the rounds,
since only figures of one round have met the same machine.

    make bench-peers
    python tests/benchmarks/bench_robot_peers.py --n 9 --seconds 5 --json
    python tests/benchmarks/bench_robot_peers.py --only rigid-plume crazyflow
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from bench_peers import FOLDER, OWN, PEERS_PYTHON, positive

# What each of our batches is compared with.
REFERENCE = "crazyflow"
N_ROBOTS = 10_000
# Of the last lines that a failed contestant prints.
N_SHOWN_CHARACTERS = 200
_SEARCH = "commands at 10 Hz, autopilot, nose, anemometer, referee"
_BODY = "rigid body, rotors with lag, cascade of control, wind and drag at 250 Hz"

Paces = Mapping[str, Sequence[float]]
"""Robot-seconds per second of a processor of each round, by contestant."""


@dataclass(frozen=True, kw_only=True)
class Contestant:
    """A simulator with robots, and the physics in a step of it."""

    name: str
    title: str
    family: str
    words: tuple[str, ...]
    physics: str

    def command(self, peers_python: Path) -> list[str]:
        """Return the command of its process."""
        python = Path(sys.executable) if self.family == OWN else peers_python.absolute()
        script, *options = self.words
        return [str(python), str(FOLDER / script), *options]


def _own(name: str, vehicle: str, flying: str, gas: str, physics: str) -> Contestant:
    choices = ("--vehicle", vehicle, "--flying", flying, "--gas", gas, "--robots", str(N_ROBOTS))
    title = f"gslcosim, {vehicle}, {flying}, {gas}"
    physics = f"{physics}; {gas}; {_SEARCH}"
    return Contestant(name=name, title=title, family=OWN, words=("gslcosim_robots.py", *choices), physics=physics)


CONTESTANTS = (
    _own("rigid-plume", "iris", "rigid_body", "gaussian_plume", _BODY),
    _own("rigid-filaments", "iris", "rigid_body", "filament", _BODY),
    _own("first-order-plume", "iris", "first_order", "gaussian_plume", "lagged mass, wind and drag at 50 Hz"),
    _own("point-plume", "holonomic", "exact", "gaussian_plume", "mass at 50 Hz"),
    _own("point-filaments", "holonomic", "exact", "filament", "mass at 50 Hz"),
    *(
        Contestant(
            name=name,
            title=f"crazyflow, {dynamics}",
            family="crazyflow",
            words=("crazyflow_robots.py", "--dynamics", dynamics, "--robots", "1000"),
            physics=f"{physics}, cascade of control at 500 Hz; no wind, no gas",
        )
        for name, dynamics, physics in (
            (REFERENCE, "first_principles", "rigid body, rotors with lag"),
            ("crazyflow-so-rpy", "so_rpy", "second-order attitude"),
        )
    ),
    Contestant(
        name="hyperdrone",
        title="hyperdrone, motor commands",
        family="hyperdrone",
        words=("hyperdrone_robots.py", "--robots", str(N_ROBOTS)),
        physics="rigid body, rotors with lag at 100 Hz; no control, no wind, no gas",
    ),
    Contestant(
        name="mosaik",
        title="mosaik, point masses",
        family="mosaik",
        words=("mosaik_robots.py", "--robots", "100"),
        physics="messages between vehicles and agents at 10 Hz, lagged mass on a line; no gas",
    ),
)


class Racer:
    """The process of a contestant; `absence` is the reason, in a line, where it does not take part."""

    def __init__(self, contestant: Contestant, peers_python: Path) -> None:
        self.contestant = contestant
        self.absence: str | None = None
        self.version = contestant.title
        # Packages write files where they run; and a pipe of errors would fill up.
        self._folder = tempfile.TemporaryDirectory(prefix="peers-")
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - it is closed with the process
        try:
            self._process = subprocess.Popen(
                contestant.command(peers_python), cwd=self._folder.name,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True,
            )  # fmt: skip
        except OSError as error:
            self.absence = f"{contestant.title}: left out, its Python cannot be started ({error.strerror})."

    def build(self) -> None:
        """Wait until it has built its robots; one that fails takes no part."""
        if self.absence is None and (answer := self._read()) is not None:
            self.version = str(answer["version"])

    def run(self, seconds: float) -> float:
        """Return its robot-seconds per second of a processor.

        Args:
            seconds: How long it is to be busy [s].
        """
        assert self._process.stdin is not None, "it is a pipe"
        self._process.stdin.write(f"{seconds}\n")
        self._process.stdin.flush()
        if (answer := self._read()) is None:
            sys.exit(f"{self.absence}")
        return float(answer["robot_s"]) / float(answer["cpu_s"])

    def close(self) -> None:
        """End the process."""
        if self.absence is None:
            self._process.kill()
            self._process.communicate()
        self._errors.close()
        self._folder.cleanup()

    def _read(self) -> dict[str, float] | None:
        assert self._process.stdout is not None, "it is a pipe"
        # Packages may print lines of their own.
        for line in self._process.stdout:
            if line.startswith("{"):
                return json.loads(line)
        self._process.communicate()
        self._errors.seek(0)
        (last,) = self._errors.read().strip().splitlines()[-1:] or ["without a message"]
        self.absence = f"{self.contestant.title}: left out, it cannot run here ({last[-N_SHOWN_CHARACTERS:]})."
        return None


def ratios(name: str, paces: Paces) -> list[float] | None:
    """Return a contestant's pace over that of the reference in each round, if both took part."""
    if name not in paces or REFERENCE not in paces:
        return None
    return [own / peer for own, peer in zip(paces[name], paces[REFERENCE], strict=True)]


def table(paces: Paces) -> str:
    """Return the table: medians with the lowest and highest of the rounds, ratios to the reference, and physics."""
    lines = [f"{'robot-s per CPU-s':44}{'median':>9}{'lowest':>9}{'highest':>9}{'ratio':>8}  physics"]
    for contestant in CONTESTANTS:
        if (rounds := paces.get(contestant.name)) is None:
            continue
        figures = (statistics.median(rounds), min(rounds), max(rounds))
        ratio = ratios(contestant.name, paces)
        cells = "".join(f"{figure:9,.0f}" for figure in figures)
        shown = "-" if ratio is None else f"{statistics.median(ratio):.2f}"
        lines.append(f"{contestant.title:44}{cells}{shown:>8}  {contestant.physics}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure all in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=positive, default=5, help="how many rounds (default 5)")
    parser.add_argument("--seconds", type=positive, default=3, help="seconds of a processor in a round (default 3)")
    parser.add_argument("--only", nargs="+", default=[], choices=[c.name for c in CONTESTANTS], help="fewer of them")
    parser.add_argument("--peers-python", type=Path, default=PEERS_PYTHON, help="the Python that has the others")
    parser.add_argument("--json", action="store_true", help="print all figures of all rounds as JSON")
    options = parser.parse_args()
    chosen = [contestant for contestant in CONTESTANTS if not options.only or contestant.name in options.only]
    with ExitStack() as stack:
        racers: list[Racer] = []
        for contestant in chosen:
            racers.append(Racer(contestant, options.peers_python))
            stack.callback(racers[-1].close)
            racers[-1].build()
        taking_part = [racer for racer in racers if racer.absence is None]
        paces: dict[str, list[float]] = {racer.contestant.name: [] for racer in taking_part}
        for i in range(options.n):
            # Every second round goes backwards, so that none is always after the same.
            for racer in taking_part[:: -1 if i % 2 else 1]:
                paces[racer.contestant.name].append(racer.run(options.seconds))
    absences = [racer.absence for racer in racers if racer.absence is not None]
    versions = list(dict.fromkeys(racer.version for racer in taking_part))
    if options.json:
        sys.stdout.write(json.dumps({"robot_s_per_cpu_s": paces, "versions": versions, "left_out": absences}) + "\n")
        return
    sys.stdout.write(f"{', '.join(versions)}: medians of {options.n} rounds of {options.seconds} s in turns\n")
    sys.stdout.write(table(paces))
    sys.stdout.writelines(f"{absence}\n" for absence in absences)


if __name__ == "__main__":
    main()
