"""What a decision of each bundled search method costs, beside its limit and beside a plain loop of numpy.

`make bench-methods` prints it. Agent objects fly through a scripted room (method_flights.py), in this process and on
one thread; what counts is the processor time of a decision together with the observations since the one before it, the
least of three equal runs, so that other programs on the machine hardly matter. The first decisions of a run are
left out: they load what numba has compiled.

Beside it stands what a look one move ahead takes in plain numpy: for each move and each of four counts of hits the
posterior over all cells and its entropy, on as many cells as the belief that the method publishes, or on 75 x 75.

`alone` is the 95th percentile of the decision without the observations before it, which come ten times a second while
the vehicle flies and holds. PASS: the 95th percentile with them keeps the limit of the method's card. With names as
arguments only these are run; `--save` writes docs/studies/method_costs.json, from which the page of methods takes its
column.
"""

import argparse
import json
import os
import platform
import sys
import time
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

# Before numpy is imported: processor time is measured on this thread alone.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(Path(__file__).parent))

from method_flights import Flight, robots_of  # noqa: E402 - beside this file

from gslcosim.base.bundled import bundled_agents  # noqa: E402
from gslcosim.methods.card import CARD_FILE, MethodCard, load_card  # noqa: E402
from gslcosim.runtime.agents.loader import load_python_agent  # noqa: E402

COSTS = ROOT / "docs" / "studies" / "method_costs.json"
N_WARM, N_DECISIONS = 20, 300
N_FLIGHTS, N_REPEATS = 3, 5
PLAN_CELLS = 75 * 75
N_HITS = 4


@dataclass(frozen=True, kw_only=True)
class Cost:
    """What a method's decisions took [ms], on how many cells, and what plain numpy takes on as many."""

    name: str
    card: MethodCard
    n_robots: int
    n_decisions: int
    n_cells: int
    p50_ms: float
    p95_ms: float
    alone_ms: float
    numpy_ms: float

    @property
    def is_within_limit(self) -> bool:
        """Whether the 95th percentile keeps the card's limit."""
        return self.p95_ms <= self.card.decision_limit_ms

    def row(self) -> str:
        """Return the line of the table."""
        return (
            f"{self.name:<24} {self.n_robots:>6} {self.n_decisions:>9} {self.p50_ms:>9.3f} {self.p95_ms:>9.3f} "
            f"{self.alone_ms:>9.3f} {self.card.decision_limit_ms:>7g} {self.n_cells:>7} {self.numpy_ms:>9.3f} "
            f"{self.p95_ms / self.numpy_ms:>7.2f}  {'PASS' if self.is_within_limit else 'MISS'}"
        )


def methods() -> dict[str, Path]:
    """Return the programs of the bundled Python agents that have a method card, by name."""
    return {name: path for name, path in bundled_agents().items() if path.with_name(CARD_FILE).is_file()}


def cost_of(name: str, program: Path, numpy_ms: dict[tuple[int, int], float]) -> Cost:
    """Fly a method and return what its decisions took."""
    card = load_card(program.with_name(CARD_FILE))
    agent_type, n_robots = load_python_agent(program), robots_of(card)
    flights = [Flight(agent_type, card) for _ in range(N_FLIGHTS)]
    n_warm = N_WARM * n_robots
    each_s = [list(islice(flight.decisions_s(), n_warm + N_DECISIONS))[n_warm:] for flight in flights]
    if not each_s[0]:
        raise RuntimeError("expected decisions after those that are left out, was none")
    # Equal seeds decide alike: what a decision took longer in one run than in another, others on the machine took.
    with_observations_s, alone_s = np.min(each_s, axis=0).T
    n_cells = max(vehicle.n_belief_cells for vehicle in flights[0].vehicles) or PLAN_CELLS
    n_moves = 5 if card.dimensions == 2 else 7
    if (n_cells, n_moves) not in numpy_ms:
        numpy_ms[n_cells, n_moves] = plain_numpy_ms(n_cells, n_moves)
    p50_ms, p95_ms = (1e3 * float(value) for value in np.percentile(with_observations_s, (50, 95)))
    return Cost(
        name=name,
        card=card,
        n_robots=n_robots,
        n_decisions=len(alone_s),
        n_cells=n_cells,
        p50_ms=p50_ms,
        p95_ms=p95_ms,
        alone_ms=1e3 * float(np.percentile(alone_s, 95)),
        numpy_ms=numpy_ms[n_cells, n_moves],
    )


def plain_numpy_ms(n_cells: int, n_moves: int) -> float:
    """Return what a look one move ahead takes over so many cells, written plainly: the best of several [ms]."""
    rng = np.random.default_rng(1)
    prior = rng.dirichlet(np.ones(n_cells))
    rates = rng.uniform(0.01, 2.0, size=(n_moves, n_cells))
    best_s = float("inf")
    for _ in range(N_REPEATS):
        began = time.thread_time()
        _expected_entropies(prior, rates)
        best_s = min(best_s, time.thread_time() - began)
    return 1e3 * best_s


def _expected_entropies(prior: np.ndarray, rates: np.ndarray) -> list[float]:
    expected = []
    for rate in rates:
        likelihood, sum_of_moves = np.exp(-rate), 0.0
        for hits in range(N_HITS):
            joint = prior * likelihood
            total = joint.sum()
            posterior = joint / total
            sum_of_moves -= total * (posterior * np.log2(posterior)).sum()
            likelihood = likelihood * rate / (hits + 1)
        expected.append(sum_of_moves)
    return expected


def save(costs: list[Cost]) -> None:
    """Write the measured costs for the page of methods; methods that were not run keep theirs."""
    saved = json.loads(COSTS.read_text(encoding="utf-8"))["methods"] if COSTS.is_file() else {}
    saved |= {cost.name: {"p50_ms": _short(cost.p50_ms), "p95_ms": _short(cost.p95_ms)} for cost in costs}
    known = methods()
    fields = {
        "command": "make bench-methods SAVE=--save",
        "machine": machine(),
        "methods": {name: saved[name] for name in sorted(saved) if name in known},
    }
    COSTS.write_text(json.dumps(fields, indent=1) + "\n", encoding="utf-8")


def machine() -> str:
    """Return the machine and what runs on it, in a few words."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        named = [line.split(":", 1)[1] for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        model = named[0].strip() if named else model
    return f"{model}, {os.cpu_count()} cores, Python {platform.python_version()}, numpy {np.__version__}"


def _short(value: float) -> float:
    return float(f"{value:.2g}")


def main() -> None:
    """Print a line for each method."""
    parser = argparse.ArgumentParser(description="What a decision of each bundled search method costs.")
    parser.add_argument("names", nargs="*", help="methods to fly (default: all)")
    parser.add_argument("--save", action="store_true", help="write docs/studies/method_costs.json")
    arguments = parser.parse_args()
    known = methods()
    sys.stdout.write(f"{machine()}; processor time on one thread [ms]\n")
    sys.stdout.write(
        f"{'method':<24} {'robots':>6} {'decisions':>9} {'p50':>9} {'p95':>9} {'alone':>9} {'limit':>7} {'cells':>7} "
        f"{'numpy':>9} {'ratio':>7}\n"
    )
    costs: list[Cost] = []
    numpy_ms: dict[tuple[int, int], float] = {}
    for name in arguments.names or known:
        try:
            costs.append(cost_of(name, known[name], numpy_ms))
            sys.stdout.write(costs[-1].row() + "\n")
        except Exception as error:  # one method that fails must not hide the others
            sys.stdout.write(f"{name:<24} FAILED: {type(error).__name__}: {str(error)[:150]}\n")
        sys.stdout.flush()
    if arguments.save:
        save(costs)


if __name__ == "__main__":
    main()
