"""Which methods beat the blind persistent walk, in cases made for them: a table with paired differences.

Every method meets the same rooms, gas and starts: what differs within a pair is the method alone. Flights run in one
process each, on two cores by default, without a recorder; finished flights are kept in a file of lines, so that a run
that was stopped goes on.

    python docs/studies/methods_in_their_cases.py                      # fly what is missing, then print the table
    python docs/studies/methods_in_their_cases.py --seeds 6 --cases meander --methods surge_cast
    python docs/studies/methods_in_their_cases.py --table              # only print what has been flown
"""

import argparse
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from paired_flights import Row, fly_fields, fly_missing, interval_text, read_rows

from gslcosim.methods.card import MethodCard, card_beside
from gslcosim.scenario.bundled import bundled_agents

CASES = Path(__file__).parent / "cases"
BASELINE = "persistent_walk"
FIRST_SEED = 100
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
    rows = read_rows(arguments.results, Trial)
    if not arguments.table:
        rows = fly_missing(trials, fly_one, n_jobs=arguments.jobs, path=arguments.results)
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


def fly_one(trial: Trial) -> Row:
    """Fly one trial; return what the table needs of it."""
    return fly_fields(scenario_of(trial), seed=trial.seed)


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


def table(rows: dict[Trial, Row], trials: Iterable[Trial], cards: dict[str, MethodCard]) -> str:
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


def _line(case: str, method: str, n_robots: int, pairs: list[tuple[Row, Row]]) -> str:
    success = 100 * np.array([[pair["success"] for pair in both] for both in pairs], float)
    time_s = np.array([[pair["time_s"] for pair in both] for both in pairs])
    return (
        f"| {case} | {method} | {n_robots} | {len(pairs)} | {success[:, 0].mean():.0f} | {time_s[:, 0].mean():.0f} | "
        f"{interval_text(success[:, 0] - success[:, 1])} | {interval_text(time_s[:, 0] - time_s[:, 1])} |"
    )


if __name__ == "__main__":
    main()
