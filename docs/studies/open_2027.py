"""Prints the table of the pilot of the open comparison of 2027: which scenarios its nulls solve, and are to be redrawn.

Run with `python docs/studies/open_2027.py RESULTS`: results of `open_2027` with its nulls, with the practice seed. The
rule is on docs/benchmark/open_2027.md: a scenario in which a null is right in more than half of at least ten flights is
redrawn; with fewer flights more are asked for. The exit status is 1 where there is such a scenario.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gslcosim_bench.report.null_differences import find_nulls
from gslcosim_bench.report.number_formats import format_estimate, format_percent
from gslcosim_bench.report.report_data import ReportData, load_report_data
from gslcosim_bench.statistics.estimates import Estimate
from gslcosim_bench.statistics.rates import wilson

MOST_SOLVED = 0.5
"""Share of its flights that a null may solve in a scenario that is published."""

LEAST_FLIGHTS = 10
"""Flights of a null before which no scenario is redrawn: of five, one that is right in 40 % solves three in a third."""


@dataclass(frozen=True, kw_only=True)
class PilotScenario:
    """A scenario of the pilot.

    Attributes:
        rates: Success of each null by its name, over flights with gas.
        approach: Share of the flights of the null that moves most which came within 1 m of a source.
    """

    scenario: str
    rates: dict[str, Estimate]
    approach: Estimate

    @property
    def verdict(self) -> str:
        """`no`; `yes` where a null is right in more than half of enough flights; `more flights` of fewer."""
        solved = [rate for rate in self.rates.values() if rate.value > MOST_SOLVED]
        if any(rate.n >= LEAST_FLIGHTS for rate in solved):
            return "yes"
        return "more flights" if solved else "no"


def judge_scenarios(material: ReportData) -> list[PilotScenario]:
    """Return each scenario with the success of the nulls that have flown it, in the suite's order."""
    rows, nulls = material.rows, find_nulls(material)
    found: list[PilotScenario] = []
    for scenario in dict.fromkeys(rows["scenario"].tolist()):
        rates: dict[str, Estimate] = {}
        approaches: list[Estimate] = []
        for null in nulls:
            own = ~rows.is_control & (rows.entry == null) & (rows["scenario"] == scenario)
            if own.any():
                n = int(own.sum())
                rates[material.entries[null].name] = wilson(int(rows["success"][own].sum()), n)
                near = np.isfinite(rows["time_within_1_m_s"][own])
                approaches.append(wilson(int(near.sum()), n))
        if rates:
            approach = max(approaches, key=lambda each: each.value)
            found.append(PilotScenario(scenario=scenario, rates=rates, approach=approach))
    return found


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("results", type=Path, help="results of open_2027 with its nulls")
    scenarios = judge_scenarios(load_report_data(parser.parse_args().results))
    names = list(dict.fromkeys(name for each in scenarios for name in each.rates))
    lines = [
        f"| scenario | {' | '.join(f'`{name}` [%]' for name in names)} | came within 1 m [%] | flights | redrawn |"
    ]
    lines.append(f"| --- |{' --: |' * (len(names) + 2)} --- |")
    for each in scenarios:
        cells = [format_estimate(each.rates[n], format_percent) if n in each.rates else "" for n in names]
        n_flights = max(rate.n for rate in each.rates.values())
        said = each.verdict if each.verdict == "no" else f"**{each.verdict}**"
        near = format_percent(each.approach.value)
        lines.append(f"| `{each.scenario}` | {' | '.join(cells)} | {near} | {n_flights} | {said} |")
    sys.stdout.write("\n".join(lines) + "\n")
    sys.exit(any(each.verdict != "no" for each in scenarios))


if __name__ == "__main__":
    main()
