"""Races of entries that were left out, on recorded and on simulated rows: is the place right, does the interval hold.

    make raced-entries
    python tests/benchmarks/raced_entries.py --races 1000
    python tests/benchmarks/raced_entries.py --even

Each entry of a table races the others' rows with a share of the flights, once with each of several random streams. The
recorded tables are those of the study of the open comparison (docs/studies/open_2026.md), without cases whose start no
vehicle left. The simulated ones have 29 cases of ten flights, as the whole suite has, and entries from 5 to 65 %
success: in one kind rooms differ little for all entries, in the other cases are easy or hard for all of them.

A coverage of 95 % passes from the 2.5 % point of the binomial distribution on. It is one of races, not of times: one
estimate of a race whose interval leaves out the score of the whole suite makes it a miss. The last column allows for
what the whole suite leaves open itself: it has the share of races whose place is at most one off the places that the
comparison of all pairs, with all flights, gives the entry (`compare_entries`).

`--even` draws by the weight of cases alone, for comparison.
"""

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
from scipy import stats
from simulated_entries import draw_figures

from gslcosim_bench.statistics import racing
from gslcosim_bench.statistics.racing import find_place, replay_race, weigh_flights
from gslcosim_bench.statistics.ranking import compare_entries
from gslcosim_bench.statistics.sampling_units import SamplingUnits, find_sampling_units

STUDIES = Path(__file__).parents[2] / "docs" / "studies"
SHARES = (0.15, 0.3)
# Of simulated suites: cases and flights of each, as in open_2026, entries and suites of each number of entries.
CASES, FLIGHTS = 29, 10
ENTRIES = {5: 12, 11: 6, 28: 4}
QUALITY = (0.05, 0.65)


@dataclass(frozen=True, kw_only=True)
class Table:
    """Scores (n, k) of entries in flights, the case of each, and what the comparison of all pairs draws."""

    name: str
    scores: np.ndarray
    cases: np.ndarray
    units: SamplingUnits


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--races", type=int, default=500, help="least number of races of each row")
    parser.add_argument("--even", action="store_true", help="draw by the weight of cases alone")
    options = parser.parse_args()
    if options.even:
        racing._EVEN_FRAC = 1.0
    for title, tables in (
        ("Recorded rows", list(read_tables())),
        ("Simulated rows", list(draw_tables())),
    ):
        write(f"{title}\n")
        write(
            "| rows | flights | entries | share flown | races | interval holds | | its width | places in it | "
            "error of the score | place within ±1 | of those the suite leaves open |"
        )
        write(f"|{'---|' * 12}")
        for share in SHARES:
            by_name: dict[str, list[tuple[float, ...]]] = {}
            facts: dict[str, tuple[int, int, int]] = {}
            n_entries = Counter[str]()
            for table in tables:
                n_entries[table.name] += table.scores.shape[1]
            for table in tables:
                n_streams = math.ceil(options.races / n_entries[table.name])
                by_name.setdefault(table.name, []).extend(race(table, share, n_streams))
                facts[table.name] = (*table.scores.shape, math.floor(share * len(table.scores)))
            for name, races in by_name.items():
                write(format_races(name, facts[name], share, np.array(races)))
        write("")


def race(table: Table, share: float, n_streams: int) -> Iterator[tuple[float, ...]]:
    """Yield of each race: held, width, places, error of the score, place within one, within one of what is open."""
    weights, n = weigh_flights(table.cases), table.scores.shape[1]
    means = weights @ table.scores
    ranks = compare_entries(
        {"score": table.scores}, ranked_by="score", lower_is_better=False, units=table.units,
        cases=table.units.case, limit=1.0, n_signs=1000,
    ).ranks  # fmt: skip
    for entry in range(n):
        place = find_place(means[entry], np.delete(means, entry))
        first, last = ranks[entry]
        for stream in range(n_streams):
            told = replay_race(
                table.scores, entry, table.cases, seed=[stream, entry], budget=math.floor(share * len(table.scores))
            )
            end = told[-1]
            yield (
                all(each.low - 1e-9 <= means[entry] <= each.high + 1e-9 for each in told),
                end.high - end.low,
                end.n_places,
                end.score - means[entry],
                abs(end.place - place) <= 1,
                first - 1 <= end.place <= last + 1,
            )


def format_races(name: str, facts: tuple[int, int, int], share: float, races: np.ndarray) -> str:
    """Return a row of a table."""
    held, width, places, error, is_near, is_open = races.T
    n = len(races)
    least = stats.binom.ppf(0.025, n, 0.95) / n
    return (
        f"| {name} | {facts[0]} | {facts[1]} | {100 * share:.0f} %, {facts[2]} | {n} | {percent(held.mean())} | "
        f"{'PASS' if held.mean() >= least else 'MISS'} | {width.mean():.2f} | {places.mean():.1f} | "
        f"{np.sqrt((error**2).mean()):.3f} | {percent(is_near.mean())} | {percent(is_open.mean())} |"
    )


def read_tables() -> Iterator[Table]:
    """Yield the tables of the study: the whole suite in seed C, and quick profiles."""
    sys.path.insert(0, str(STUDIES))
    study = import_module("open_2026_data")
    rows = [row for row in study.read_flights() if not row["is_control"]]
    # The oracle has flown the quick profile alone.
    of_quick = {(row["results"], row["case"], row["repetition"]) for row in rows if row["entry"] == "oracle"}
    quick = [row for row in rows if (row["results"], row["case"], row["repetition"]) in of_quick]
    for name, seeds, chosen in (
        ("C, whole", "C", rows),
        ("A and B, quick", "AB", quick),
        ("A to C, quick", "ABC", quick),
        ("C, quick", "C", quick),
    ):
        by_entry: dict[str, dict[tuple[str, str, int], dict]] = {}
        for row in chosen:
            if study.SEEDS[row["results"]] in seeds:
                by_entry.setdefault(row["entry"], {})[row["results"], row["case"], row["repetition"]] = row
        n_flights = max(map(len, by_entry.values()))
        entries = [entry for entry, found in by_entry.items() if len(found) == n_flights]
        flights = list(by_entry[entries[0]])
        first = [by_entry[entries[0]][flight] for flight in flights]
        cases = np.array([f"{row['results']} {row['case']}" for row in first])
        room, gas = (np.array([row[key] for row in first]) for key in ("environment_hash", "gas_seed"))
        units = find_sampling_units(room, gas, cases)
        scores = np.array([[by_entry[entry][flight]["score"] or 0.0 for entry in entries] for flight in flights])
        yield Table(name=name, scores=scores, cases=cases, units=units)


def draw_tables() -> Iterator[Table]:
    """Yield simulated suites of entries from 5 to 65 % success."""
    room = np.repeat(np.arange(CASES), FLIGHTS)
    plume = np.arange(len(room))
    units = find_sampling_units(room, plume, room)
    for kind in ("alike", "easy and hard"):
        for n_entries, n_suites in ENTRIES.items():
            quality = np.linspace(*QUALITY, n_entries)
            for i in range(n_suites):
                rng = np.random.default_rng([n_entries, i])
                scores = (
                    draw_figures(rng, quality, room, plume)["score"]
                    if kind == "alike"
                    else draw_hard(rng, quality, room)
                )
                yield Table(name=f"{n_entries} entries, cases {kind}", scores=scores, cases=room, units=units)


def draw_hard(rng: np.random.Generator, quality: np.ndarray, room: np.ndarray) -> np.ndarray:
    """Return scores in cases and flights that are easy or hard for all, each entry with its own strengths by case."""
    hard = rng.normal(0.0, 1.5, CASES)[room] + rng.normal(0.0, 1.0, len(room))
    own = rng.normal(0.0, 0.7, (CASES, len(quality)))[room]
    rate = 1.0 / (1.0 + np.exp(hard[:, None] - 1.6 * np.log(quality / (1.0 - quality)) - own))
    return (rng.random(rate.shape) < rate) * (1.0 - 0.5 * rng.random(rate.shape))


def percent(share: float) -> str:
    """Return a share in per cent."""
    return f"{100 * share:.1f} %"


def write(line: str) -> None:
    """Print a line at once: the tables take minutes."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
