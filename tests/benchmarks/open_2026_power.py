"""Power of the report of `open_2026` to tell differences apart: simulated results of its cases, rooms and entries.

    python tests/benchmarks/open_2026_power.py --suites 100

A room adds up to 15 points to all entries, and room and plume up to 10 points each to each entry.
"""

import argparse
import sys

import numpy as np

from gslcosim.base.bundled import bundled_suites
from gslcosim_bench.cases.models import Case
from gslcosim_bench.cases.plan import expand_cases
from gslcosim_bench.cases.suite_files import load_suite
from gslcosim_bench.statistics.ranking import compare_entries
from gslcosim_bench.statistics.sampling_units import find_sampling_units

# Five groups of equal entries, ten points apart.
QUALITY = {
    2: lambda gap: np.array([0.6, 0.6 - gap]),
    27: lambda _: np.repeat([0.6, 0.5, 0.4, 0.3, 0.2], [6, 6, 5, 5, 5]),
}
GAPS = (0.1, 0.2, 0.3)


def main() -> None:
    """Print the share of pairs told apart, by their difference and the number of entries."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suites", type=int, default=100, help="simulated results of each number of entries")
    n = parser.parse_args().suites
    cases = [case for _, case in expand_cases(load_suite(bundled_suites()["open_2026"]))]
    rooms = list(dict.fromkeys(map(room_of, cases)))
    room_of_case = np.array([rooms.index(room_of(case)) for case in cases])
    sys.stdout.write(
        f"{len(rooms)} rooms\n| difference | {' | '.join(f'{k} entries' for k in QUALITY)} |\n|---|---|---|\n"
    )
    for gap in GAPS:
        shares = [told_apart(cases, room_of_case, quality(gap), gap, n) for quality in QUALITY.values()]
        sys.stdout.write(f"| {100 * gap:.0f} points | {' | '.join(f'{100 * share:.0f} %' for share in shares)} |\n")


def room_of(case: Case) -> tuple[str, ...]:
    """Return what makes the air of a case: its file, and what the suite sets of layout and wind."""
    return case.source.name, *sorted(o for o in case.overrides if o.startswith(("environment.", "wind.", "events=")))


def told_apart(cases: list[Case], room_of_case: np.ndarray, quality: np.ndarray, gap: float, n: int) -> float:
    """Return the share of pairs with a difference that the comparison of all entries tells apart."""
    case = np.repeat(np.arange(len(cases)), [case.repetitions for case in cases])
    room, plume = room_of_case[case], np.arange(len(case))
    units, rng, told = find_sampling_units(room, plume, case), np.random.default_rng(len(quality)), list[bool]()
    for seed in range(n):
        n_rooms, n_entries = int(room.max()) + 1, len(quality)
        rate = quality + rng.uniform(-0.15, 0.15, n_rooms)[room, None]
        rate = rate + rng.uniform(-0.1, 0.1, (n_rooms, n_entries))[room]
        rate = rate + rng.uniform(-0.1, 0.1, (len(room), n_entries))
        success = (rng.random(rate.shape) < rate).astype(float)
        score = success * (1.0 - 0.5 * rng.random(rate.shape))
        found = compare_entries(
            {"score": score, "success": success}, ranked_by="score", lower_is_better=False, units=units, cases=case,
            limit=1.0, seed=seed,
        )  # fmt: skip
        told += [p.verdict != 0 for p in found.pairs if abs(abs(quality[p.a] - quality[p.b]) - gap) < 1e-9]
    return float(np.mean(told))


if __name__ == "__main__":
    main()
