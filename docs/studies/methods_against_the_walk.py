"""Which methods beat the persistent walk, and where: paired differences from results of `methods` or `swarms`.

    gslcosim bench run methods
    python docs/studies/methods_against_the_walk.py results/methods
    gslcosim bench run swarms
    python docs/studies/methods_against_the_walk.py results/swarms

Every entry is paired with the walk of as many robots on the same case, start, gas and noise. The walk smells nothing:
an entry that is not quicker than it does not use the gas there.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

from gslcosim_bench import Results, compare
from gslcosim_bench.results import Comparison
from gslcosim_bench.statistics.estimates import Estimate

WALK = "persistent_walk"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, help="results of methods or swarms")
    results = Results.load(parser.parse_args().results).select(is_control=False)
    sys.stdout.write(f"{against_the_walk(results)}\n{by_case(results)}")


def holm(p: np.ndarray) -> np.ndarray:
    """Return (m,) p values after Holm 1979, A simple sequentially rejective multiple test procedure."""
    order = np.argsort(p, kind="stable")
    corrected = np.empty(p.shape)
    corrected[order] = np.maximum.accumulate(np.minimum(1.0, p[order] * np.arange(p.size, 0, -1)))
    return corrected


def against_the_walk(results: Results) -> str:
    """Return for each entry its success, and in each family of cases how much sooner than the walk it is there."""
    walks = dict(_walks(results))
    rivals = [entry for entry in results.entries if entry not in walks.values()]
    families = list(dict.fromkeys(results.array("family").tolist()))
    told = {entry: compare(results, entry, walks[_robots(results, entry)]) for entry in rivals}
    p = dict(zip(told, holm(np.array([one.time_p for one in told.values()])), strict=True))
    heads = ["entry", "n", "success, %", "more success, points", "sooner, s", "p", *(f"{name}, s" for name in families)]
    lines = [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|"]
    for entry in sorted(rivals, key=lambda name: told[name].time_s.value):
        one = told[entry]
        parts = [compare(results.select(family=name), entry, one.b) for name in families]
        cells = [percent(results.success(entry)), signed(one.success, 100), sooner(one), f"{p[entry]:.2g}"]
        lines.append(f"| `{entry}` | {one.n} | {' | '.join([*cells, *(sooner(part) for part in parts)])} |")
    walked = ", ".join(f"`{name}` {percent(results.success(name))} %" for name in walks.values())
    return "\n".join(lines) + f"\n\nThe walk itself: {walked}.\n"


def by_case(results: Results) -> str:
    """Return the successes of each entry in each case, most successful entry first."""
    scenarios = list(dict.fromkeys(results.array("scenario").tolist()))
    lines = [f"| entry | {' | '.join(scenarios)} | all |", "|---" * (len(scenarios) + 2) + "|"]
    for entry in sorted(results.entries, key=lambda name: -results.success(name).value):
        own = results.select(entry=entry)
        found = [own.select(scenario=name).array("success") for name in scenarios]
        n = {len(one) for one in found}
        cells = [f"{one.sum()}" if len(n) == 1 else f"{one.sum()}/{len(one)}" for one in found]
        lines.append(f"| `{entry}` | {' | '.join(cells)} | {own.array('success').sum()} of {len(own)} |")
    return "\n".join(lines) + "\n"


# How many robots each walk has, and its name.
def _walks(results: Results) -> list[tuple[int, str]]:
    return [(_robots(results, name), name) for name in results.entries if name.startswith(WALK)]


def _robots(results: Results, entry: str) -> int:
    told = {one["name"]: one["robots"] for one in results.manifest["entries"]}
    return int(told[entry])


def sooner(one: Comparison) -> str:
    """Return how much sooner an entry is there than the walk [s], bold where the interval leaves no doubt."""
    text = signed(Estimate(-one.time_s.value, -one.time_s.high, -one.time_s.low, one.n))
    return text if one.time_s.holds_zero or one.time_s.value > 0 else f"**{text}**"


def signed(figure: Estimate, scale: float = 1.0) -> str:
    """Return a difference with its interval."""
    return f"{scale * figure.value:+.0f} [{scale * figure.low:+.0f}, {scale * figure.high:+.0f}]"


def percent(figure: Estimate) -> str:
    """Return a rate with its interval in per cent."""
    return f"{100 * figure.value:.0f} [{100 * figure.low:.0f}, {100 * figure.high:.0f}]"


if __name__ == "__main__":
    main()
