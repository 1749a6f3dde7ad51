"""Which methods beat the blind persistent walk, in cases made for them: a table with paired differences.

Every method meets the same rooms, gas and starts: what differs within a pair is the method alone. Flights run in one
process each, on two cores by default, without a recorder; finished flights are kept in a file of lines, so that a run
that was stopped goes on.

    python docs/studies/methods_in_their_cases.py                      # fly what is missing, then print the table
    python docs/studies/methods_in_their_cases.py --seeds 6 --cases meander --methods surge_cast
    python docs/studies/methods_in_their_cases.py --table              # only print what has been flown
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from gslcosim.environment.random_places import draw_places
from gslcosim.methods.card import MethodCard, card_beside
from gslcosim.runtime.flight import fly
from gslcosim.scenario import load_scenario
from gslcosim.scenario.bundled import bundled_agents

CASES = Path(__file__).parent / "cases"
BASELINE = "persistent_walk"
FIRST_SEED = 100
N_BOOTSTRAP = 2000
# The cases that a family was made for; swarms fly with several robots in each.
CASES_OF_FAMILY = {
    "anchor": ("young", "meander"),
    "reactive": ("meander", "field", "young"),
    "swarm": ("meander", "young"),
    "bayesian": ("meander", "field"),
    "information": ("meander", "field"),
    "map": ("racks", "settled"),
    "learned": ("meander", "field"),
}
STARTS_APART_M = 1.5


@dataclass(frozen=True, order=True)
class Trial:
    """One flight: a method in a case with a seed, by so many robots."""

    case: str
    method: str
    seed: int
    n_robots: int = 1


def main() -> None:
    """Fly what is missing and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="seeds a case, from 100 on (default 20)")
    parser.add_argument("--cases", nargs="+", default=sorted(path.stem for path in CASES.glob("*.yaml")))
    parser.add_argument("--methods", nargs="+", default=None, help="default: all that the families say")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--results", type=Path, default=Path("runs/methods_in_their_cases.jsonl"))
    parser.add_argument("--table", action="store_true", help="fly nothing, print what there is")
    arguments = parser.parse_args()
    cards = {name: card for name, path in bundled_agents().items() if (card := card_beside(path)) is not None}
    trials = trials_of(cards, arguments)
    rows = read_rows(arguments.results)
    if not arguments.table:
        fly_missing([trial for trial in trials if trial not in rows], arguments.jobs, arguments.results, rows)
    sys.stdout.write(table(rows, trials, cards))


def trials_of(cards: dict[str, MethodCard], arguments: argparse.Namespace) -> list[Trial]:
    """Return all flights, the baseline's with as many robots as each method's among them."""
    trials: set[Trial] = set()
    for name, card in cards.items():
        if (arguments.methods and name not in arguments.methods) or card.needs.sensors.get("camera"):
            continue
        n_robots = card.robots if isinstance(card.robots, int) else card.robots[0]
        for case in CASES_OF_FAMILY.get(card.family, ()):
            if case in arguments.cases:
                for seed in range(FIRST_SEED, FIRST_SEED + arguments.seeds):
                    trials |= {Trial(case, name, seed, n_robots), Trial(case, BASELINE, seed, n_robots)}
    return sorted(trials)


def fly_missing(trials: list[Trial], n_jobs: int, path: Path, rows: "dict[Trial, dict]") -> None:
    """Fly trials on some cores and append a line for each."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(n_jobs) as pool, path.open("a") as file:
        futures = {pool.submit(fly_one, trial): trial for trial in trials}
        for n_done, future in enumerate(as_completed(futures), 1):
            trial, row = futures[future], future.result()
            rows[trial] = row
            file.write(json.dumps({"trial": vars(trial), **row}) + "\n")
            file.flush()
            sys.stderr.write(f"\r{n_done} of {len(trials)} flights")
    sys.stderr.write("\n")


def fly_one(trial: Trial) -> dict:
    """Fly one trial; return what the table needs of it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.yaml"
        path.write_text(yaml.safe_dump(scenario_of(trial), sort_keys=False))
        loaded = load_scenario(path, seed=trial.seed, placer=draw_places)
        result = fly(loaded, runs_dir=Path(folder), in_process=True).result
    agents = result["agents"]
    times_s = [agent["time_to_source_s"] for agent in agents if agent["success"]]
    limit_s = loaded.scenario.referee.stop.time_limit_s
    beliefs = [agent["belief"]["mass_near_frac"] for agent in agents if agent["belief"]]
    return {
        "success": bool(times_s),
        "time_s": min(times_s, default=limit_s),
        "limit_s": limit_s,
        "declared_error_m": min(
            (a["declared_error_m"] for a in agents if a["declared_error_m"] is not None), default=None
        ),
        "belief": max(beliefs, default=None),
        "faults": [fault["text"] for fault in result["faults"]],
    }


def scenario_of(trial: Trial) -> dict:
    """Return a case with a method, its sensors and grants, and as many robots as it wants."""
    fields = yaml.safe_load((CASES / f"{trial.case}.yaml").read_text())
    card = card_beside(bundled_agents()[trial.method])
    assert card is not None
    (agent,) = fields["agents"]
    agent["start"] = {"python": trial.method}
    agent["knows"] = dict.fromkeys(card.needs.knows, True)
    agent["sensors"] = sensors_of(card)
    if trial.n_robots > 1:
        fields["channels"] = [{"name": "radio"}]
    robots = []
    for i in range(trial.n_robots):
        start = agent["start"] if i == 0 else {"process_of": "searcher_1"}
        vehicle = {**agent["vehicle"], **({"separation_m": 0.4} if trial.n_robots > 1 else {})}
        robots.append({**agent, "name": f"searcher_{i + 1}", "start": start, "vehicle": vehicle})
    fields["agents"] = robots
    return fields


def sensors_of(card: MethodCard) -> list[dict]:
    """Return a MOX sensor for methods that need ohms, else a PID; a second one beside it where two are needed."""
    model = "tgs2600" if "gas_ohm" in card.needs.sensors else "pid"
    n_noses = max((n for kind, n in card.needs.sensors.items() if kind.startswith("gas")), default=1)
    places_m = [[0.0, 0.25, 0.0], [0.0, -0.25, 0.0]] if n_noses > 1 else [[0.0, 0.0, 0.0]]
    noses = [{"model": model, "name": f"nose_{i + 1}", "mount_m": place} for i, place in enumerate(places_m)]
    ranges = [{"model": "four_range_finders", "name": "ranges"}] if "range" in card.needs.sensors else []
    return [*noses, {"model": "anemometer", "name": "wind"}, *ranges]


def read_rows(path: Path) -> "dict[Trial, dict]":
    """Return what has been flown; a line that was cut off is left out."""
    rows: dict[Trial, dict] = {}
    for line in path.read_text().splitlines() if path.exists() else ():
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            continue
        rows[Trial(**row.pop("trial"))] = row
    return rows


def table(rows: "dict[Trial, dict]", trials: Iterable[Trial], cards: dict[str, MethodCard]) -> str:
    """Return the table as Markdown: success, restricted mean time, and both minus the baseline's on the same seeds."""
    lines = [
        "| case | method | robots | n | success % | mean time s | success minus walk, points | time minus walk, s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    groups = sorted({(trial.case, cards[trial.method].family, trial.method, trial.n_robots) for trial in trials})
    for case, _, method, n_robots in groups:
        seeds = [t.seed for t in trials if (t.case, t.method, t.n_robots) == (case, method, n_robots)]
        pairs = [
            (rows[mine], rows[walk])
            for seed in sorted(seeds)
            if (mine := Trial(case, method, seed, n_robots)) in rows
            and (walk := Trial(case, BASELINE, seed, n_robots)) in rows
        ]
        if pairs:
            lines.append(_line(case, method, n_robots, pairs))
    return "\n".join(lines) + "\n"


def _line(case: str, method: str, n_robots: int, pairs: list[tuple[dict, dict]]) -> str:
    success = np.array([[pair["success"] for pair in both] for both in pairs], float)
    time_s = np.array([[pair["time_s"] for pair in both] for both in pairs])
    gain = _interval(100 * (success[:, 0] - success[:, 1]))
    delay = _interval(time_s[:, 0] - time_s[:, 1])
    return (
        f"| {case} | {method} | {n_robots} | {len(pairs)} | {100 * success[:, 0].mean():.0f} | "
        f"{time_s[:, 0].mean():.0f} | {gain} | {delay} |"
    )


# The mean of the differences of pairs, and the middle 95 % of means over seeds drawn again.
def _interval(differences: np.ndarray) -> str:
    rng = np.random.default_rng(0)
    means = differences[rng.integers(len(differences), size=(N_BOOTSTRAP, len(differences)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return f"{differences.mean():+.0f} [{low:+.0f}, {high:+.0f}]"


if __name__ == "__main__":
    main()
