"""Error rates of the comparison of entries: simulated suites whose truth is known, beside binomial bands.

    make simulated-entries
    python tests/benchmarks/simulated_entries.py --suites 1000
    python tests/benchmarks/simulated_entries.py --suites 40 --power

A simulated entry succeeds with its quality, plus an effect of the room on all entries, and effects of room and plume on
each entry. Each room has two plumes with two flights each, and in one row the first of the rooms has seven times as
many, as in a suite most of whose cases share one environment. A share that is promised to be 5 % at most passes up to
the 97.5 % point of the binomial distribution of 5 %; a coverage of 95 % passes from its 2.5 % point on.

With `--power`: how many pairs the report of `open_2026` tells apart, with its cases and rooms.
"""

import argparse
import math
import sys
from collections.abc import Iterator

import numpy as np
from scipy import stats

from gslcosim.base.bundled import bundled_suites
from gslcosim_bench.cases.models import Case
from gslcosim_bench.cases.plan import expand_cases
from gslcosim_bench.cases.suite_files import load_suite
from gslcosim_bench.statistics.estimates import student_quantile
from gslcosim_bench.statistics.ranking import EntryComparison, compare_entries, estimate_means
from gslcosim_bench.statistics.sampling_units import SamplingUnits, find_sampling_units

PLUMES, FLIGHTS = 2, 2
# Entries, rooms, and how many times as many plumes the first room has.
EQUALS = ((2, 6, 1), (2, 30, 1), (6, 6, 1), (6, 12, 1), (6, 20, 7), (6, 30, 1), (12, 12, 1), (12, 30, 1), (39, 30, 1))
DIFFERENT = ((6, 6), (6, 12), (6, 30), (12, 12), (12, 30))
# Of open_2026: two entries, and five groups of equal entries, ten points apart.
QUALITY_BY_ENTRIES = {
    2: lambda gap: np.array([0.6, 0.6 - gap]),
    27: lambda _: np.repeat([0.6, 0.5, 0.4, 0.3, 0.2], [6, 6, 5, 5, 5]),
}
# A score is the success times a number of this mean.
SCORE_OF_SUCCESS = 0.75


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", type=int, default=1000, help="simulated suites of each row")
    parser.add_argument("--power", action="store_true", help="pairs that the report of open_2026 tells apart")
    options = parser.parse_args()
    n = options.suites
    for table in (power(n),) if options.power else (equals(n), differences(n), levels(n)):
        for line in table:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
        sys.stdout.write("\n")


def equals(n: int) -> Iterator[str]:
    """Yield how often equal entries get other ranks than the first."""
    most = stats.binom.ppf(0.975, n, 0.05) / n
    yield f"Equal entries, {n} suites each: share of suites with any rank but the first (band: up to {percent(most)})."
    yield "| entries | rooms | one family | leader against each other, uncorrected | |"
    yield "|---|---|---|---|---|"
    for n_entries, n_rooms, times in EQUALS:
        rng, split, naive = np.random.default_rng([1, n_entries, n_rooms]), 0, 0
        for seed in range(n):
            found, figures = compared(rng, np.full(n_entries, 0.5), n_rooms, seed, times)
            split += len(set(found.ranks)) > 1
            naive += leader_beats_any(figures["score"], found.units)
        yield (
            f"| {n_entries} | {n_rooms}{', one with a quarter of the weight' if times > 1 else ''} | "
            f"{percent(split / n)} | {percent(naive / n)} | "
            f"{'PASS' if split / n <= most else 'MISS'} |"
        )


def differences(n: int) -> Iterator[str]:
    """Yield how often all intervals together hold known differences, and what is told apart."""
    least = stats.binom.ppf(0.025, n, 0.95) / n
    yield (
        f"Entries from 35 to 65 % success, {n} suites each: share of suites in which all is true (band: from "
        f"{percent(least)})."
    )
    yield "| entries | rooms | all intervals | all ranks | pairs of 6 to 15 points told apart | of 24 to 30 points | |"
    yield "|---|---|---|---|---|---|---|"
    for n_entries, n_rooms in DIFFERENT:
        rng, quality = np.random.default_rng([2, n_entries, n_rooms]), np.linspace(0.35, 0.65, n_entries)
        held, ranked, told = 0, 0, {"near": list[bool](), "far": list[bool]()}
        for seed in range(n):
            found, _ = compared(rng, quality, n_rooms, seed)
            truth = {(pair.a, pair.b): quality[pair.a] - quality[pair.b] for pair in found.pairs}
            held += all(
                estimate.low <= scale * truth[pair.a, pair.b] <= estimate.high
                for pair in found.pairs
                for estimate, scale in (
                    (pair.differences["success"], 1.0), (pair.differences["score"], SCORE_OF_SUCCESS),
                )
            )  # fmt: skip
            ranked += all(low <= n_entries - i <= high for i, (low, high) in enumerate(found.ranks))
            for pair in found.pairs:
                gap = -truth[pair.a, pair.b]
                key = "near" if 0.055 < gap < 0.155 else "far" if gap > 0.235 else None
                if key is not None:
                    told[key].append(pair.verdict != 0)
        yield (
            f"| {n_entries} | {n_rooms} | {percent(held / n)} | {percent(ranked / n)} | "
            f"{percent(np.mean(told['near']))} | {percent(np.mean(told['far']))} | "
            f"{'PASS' if min(held, ranked) / n >= least else 'MISS'} |"
        )


def levels(n: int) -> Iterator[str]:
    """Yield what intervals of one difference cover, by what is drawn."""
    yield f"One difference of 10 points, {n} suites each: coverage, and mean width in points, by what is drawn."
    yield "| rooms | whole rooms | rooms, then plumes, then flights, each anew | single flights |"
    yield "|---|---|---|---|"
    quality = np.array([0.55, 0.45])
    for n_rooms in (6, 12, 30):
        rng = np.random.default_rng([3, n_rooms])
        found: list[list[tuple[float, float]]] = [[], [], []]
        for _ in range(n):
            figures, units, _ = simulate(rng, quality, n_rooms)
            difference = figures["success"][:, 0] - figures["success"][:, 1]
            rooms, flights = (
                estimate_means(difference[:, None], each)[0] for each in (units, single_flights(len(difference)))
            )
            found[0].append((rooms.low, rooms.high))
            found[1].append(drawn_at_all_levels(difference.reshape(n_rooms, PLUMES, FLIGHTS), rng))
            found[2].append((flights.low, flights.high))
        ends = np.array(found)
        cells = [
            f"{percent(np.mean((each[:, 0] <= 0.1) & (each[:, 1] >= 0.1)))}, "
            f"{100 * np.mean(each[:, 1] - each[:, 0]):.0f}"
            for each in ends
        ]
        yield f"| {n_rooms} | {' | '.join(cells)} |"


def power(n: int) -> Iterator[str]:
    """Yield which share of pairs of `open_2026` is told apart, by their difference and the number of entries."""
    cases = [case for _, case in expand_cases(load_suite(bundled_suites()["open_2026"]))]
    rooms = list(dict.fromkeys(map(room_of, cases)))
    case = np.repeat(np.arange(len(cases)), [each.repetitions for each in cases])
    room = np.array([rooms.index(room_of(each)) for each in cases])[case]
    plume = np.arange(len(room))
    units = find_sampling_units(room, plume, case)
    yield f"{len(rooms)} rooms"
    yield f"| difference | {' | '.join(f'{n_entries} entries' for n_entries in QUALITY_BY_ENTRIES)} |"
    yield "|---|---|---|"
    for gap in (0.1, 0.2, 0.3):
        shares = []
        for n_entries, quality_of in QUALITY_BY_ENTRIES.items():
            quality, rng, told = quality_of(gap), np.random.default_rng(n_entries), list[bool]()
            for seed in range(n):
                figures = draw_figures(rng, quality, room, plume)
                found = compare_entries(
                    figures, ranked_by="score", lower_is_better=False, units=units, cases=case, limit=1.0, seed=seed
                )
                told += [p.verdict != 0 for p in found.pairs if abs(abs(quality[p.a] - quality[p.b]) - gap) < 1e-9]
            shares.append(percent(np.mean(told)))
        yield f"| {100 * gap:.0f} points | {' | '.join(shares)} |"


def room_of(case: Case) -> tuple[str, ...]:
    """Return what makes the air of a case: its file, and what the suite sets of layout and wind."""
    return case.source.name, *sorted(o for o in case.overrides if o.startswith(("environment.", "wind.", "events=")))


def simulate(
    rng: np.random.Generator, quality: np.ndarray, n_rooms: int, times: int = 1
) -> tuple[dict[str, np.ndarray], SamplingUnits, np.ndarray]:
    """Return figures of a suite, its units and its cases; the first room has `times` as many plumes as the others."""
    plumes = np.full(n_rooms, PLUMES)
    plumes[0] *= times
    room = np.repeat(np.arange(n_rooms), plumes * FLIGHTS)
    plume = np.arange(len(room)) // FLIGHTS
    return draw_figures(rng, quality, room, plume), find_sampling_units(room, plume, plume), plume


def draw_figures(
    rng: np.random.Generator, quality: np.ndarray, room: np.ndarray, plume: np.ndarray
) -> dict[str, np.ndarray]:
    """Return scores and successes of entries in runs, each in a room and a plume."""
    n_rooms, n_plumes, n_entries = int(room.max()) + 1, int(plume.max()) + 1, len(quality)
    rate = quality + rng.uniform(-0.15, 0.15, n_rooms)[room, None]
    rate = rate + rng.uniform(-0.1, 0.1, (n_rooms, n_entries))[room]
    rate = rate + rng.uniform(-0.1, 0.1, (n_plumes, n_entries))[plume]
    success = (rng.random(rate.shape) < rate).astype(float)
    return {"score": success * (1.0 - 0.5 * rng.random(rate.shape)), "success": success}


def compared(
    rng: np.random.Generator, quality: np.ndarray, n_rooms: int, seed: int, times: int = 1
) -> tuple[EntryComparison, dict[str, np.ndarray]]:
    """Return the comparison of the entries of a suite, and their figures."""
    figures, units, cases = simulate(rng, quality, n_rooms, times)
    found = compare_entries(
        figures, ranked_by="score", lower_is_better=False, units=units, cases=cases, limit=1.0, seed=seed, n_signs=1000
    )
    return found, figures


def leader_beats_any(score: np.ndarray, units: SamplingUnits) -> bool:
    """Return whether the interval of the leader's lead over any other alone leaves zero out."""
    leader = int(np.argmax(score.mean(axis=0)))
    others = [i for i in range(score.shape[1]) if i != leader]
    return any(each.low > 0.0 for each in estimate_means(score[:, [leader]] - score[:, others], units))


def single_flights(n: int) -> SamplingUnits:
    """Return units that take each flight for an observation of its own."""
    return find_sampling_units(np.zeros(n), np.zeros(n), np.zeros(n))


def drawn_at_all_levels(difference: np.ndarray, rng: np.random.Generator, n_draws: int = 400) -> tuple[float, float]:
    """Return the interval of a bootstrap that draws rooms, plumes of each, and flights of each, with replacement.

    Its spread is scaled by Student's quantile, so that it differs from that of whole rooms in what is drawn alone.
    """
    n_rooms = len(difference)
    room = rng.integers(0, n_rooms, (n_draws, n_rooms))[:, :, None, None]
    plume = rng.integers(0, PLUMES, (n_draws, n_rooms, PLUMES))[:, :, :, None]
    flight = rng.integers(0, FLIGHTS, (n_draws, n_rooms, PLUMES, FLIGHTS))
    means = difference[room, plume, flight].mean(axis=(1, 2, 3))
    half = student_quantile(0.975, n_rooms - 1) * means.std() * math.sqrt(n_rooms / (n_rooms - 1))
    return float(difference.mean() - half), float(difference.mean() + half)


def percent(share: float) -> str:
    """Return a share in per cent."""
    return f"{100 * share:.1f} %"


if __name__ == "__main__":
    main()
