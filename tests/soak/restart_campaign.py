"""Services killed at random ticks of runs with `restart`, and a table of what came of them: `make soak-restarts`."""

import argparse
import contextlib
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "shared"))

from real_runs import ROOT, fly_here, start

SERVICES = ("world", "fields", "sensing", "referee")
SCENARIOS = {"tiny_room": SERVICES, "swarm_tiny": (*SERVICES, "radio"), "event_source": (*SERVICES, "events")}
# Nobody comes that near: all runs last as long, and there are many ticks to be killed at.
OPTIONS = (
    "--set", "referee.success.within_m=0.02", "--set", "referee.stop.time_limit_s=90",
    "--set", "snapshots.every_s=5", "--set", "restart={}",
)  # fmt: skip
LONGEST_WAIT_S = 1.0


@dataclass(frozen=True)
class Trial:
    """What came of one run: who was killed at which tick, and whether the run is as without that."""

    scenario: str
    service: str
    tick: int
    is_restarted: bool
    is_equal: bool
    took_s: float
    text: str


def whole(scenario: str, folder: Path) -> str:
    """Return the digest of a scenario that nobody disturbs."""
    return fly_here(ROOT / "scenarios" / f"{scenario}.yaml", folder / f"whole_{scenario}", *OPTIONS).result["digest"]


def trial(scenario: str, digest: str, folder: Path, rng: random.Random) -> Trial:
    """Run a scenario, kill one of its services at a random moment, and compare."""
    service = rng.choice(SCENARIOS[scenario])
    flight = start(ROOT / "scenarios" / f"{scenario}.yaml", folder, *OPTIONS)
    pid = flight.child(f"gslcosim_services {service}")
    flight.wait_until_flying()
    time.sleep(rng.uniform(0.0, LONGEST_WAIT_S))
    # It may have ended by itself.
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)
    began_s = time.monotonic()
    ended = flight.end()
    restarts = ended.result.get("restarts", [])
    return Trial(
        scenario=scenario,
        service=service,
        tick=restarts[0]["tick"] if restarts else -1,
        is_restarted=bool(restarts),
        is_equal=ended.result.get("digest") == digest,
        took_s=time.monotonic() - began_s,
        text=ended.errors,
    )


def campaign(n_trials: int, seed: int, *, tell=lambda trial: None) -> list[Trial]:
    """Return so many trials, of all scenarios in turn."""
    rng = random.Random(seed)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        digests = {name: whole(name, folder) for name in SCENARIOS}
        trials = []
        for i in range(n_trials):
            name = list(SCENARIOS)[i % len(SCENARIOS)]
            trials.append(trial(name, digests[name], folder / str(i), rng))
            tell(trials[-1])
    return trials


def table(trials: list[Trial]) -> str:
    """Return what came of trials, a line for each service."""
    lines = [f"{'killed':10} {'runs':>5} {'restarted':>10} {'equal':>6}   ticks of death"]
    for service, n in sorted(Counter(trial.service for trial in trials).items()):
        its = [trial for trial in trials if trial.service == service]
        ticks = sorted(trial.tick for trial in its if trial.is_restarted) or [0]
        n_restarted, n_equal = sum(t.is_restarted for t in its), sum(t.is_equal for t in its)
        lines.append(f"{service:10} {n:5} {n_restarted:10} {n_equal:6}   {ticks[0]} to {ticks[-1]}")
    n_equal = sum(trial.is_equal for trial in trials)
    lines.append(f"{n_equal} of {len(trials)} runs have the digest of the run that nobody disturbed")
    return "\n".join(lines)


def main() -> None:
    """Print trials and their table; exit code 1 where one is not equal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()

    def tell(trial: Trial) -> None:
        state = "equal" if trial.is_equal else f"DIFFERENT {trial.text}"
        sys.stderr.write(f"{trial.scenario} {trial.service} at {trial.tick}, {trial.took_s:.1f} s: {state}\n")

    trials = campaign(chosen.trials, chosen.seed, tell=tell)
    sys.stdout.write(table(trials) + "\n")
    sys.exit(not all(trial.is_equal for trial in trials))


if __name__ == "__main__":
    main()
