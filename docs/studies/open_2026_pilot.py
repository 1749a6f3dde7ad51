"""Prints the tables of the pilot of the open comparison, as docs/benchmark/open_2026.md has them.

Run with `python docs/studies/open_2026_pilot.py RESULTS`, a folder of results of `open_2026` or `open_2026_quick`. It
prints, as Markdown: success by entry; for each scenario coverage, the best blind entry and the best method; and how
well strata of coverage tell methods apart.
"""

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from gslcosim.bench.report.number_formats import format_estimate, format_percent, format_score
from gslcosim.bench.report.report_data import ReportData, load_report_data
from gslcosim.bench.statistics.difficulty import STRATA, coverage_ratio, coverage_stratum, fit_discrimination
from gslcosim.bench.statistics.rates import wilson

SWEEP, ORACLE = "sweep", "oracle"


def print_table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table as Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    sys.stdout.write("".join("| " + " | ".join(map(str, line)) + " |\n" for line in lines) + "\n")


def print_entries(data: ReportData) -> None:
    """Print success by declaration, wrong declarations and approach of each entry."""
    rows = data.rows
    lines = []
    for i, entry in enumerate(data.entries):
        own = ~rows.is_control & (rows.entry == i)
        n, success = int(own.sum()), int(rows["success"][own].sum())
        wrong = int((rows["declared"][own] & ~rows["success"][own]).sum())
        near = int(np.isfinite(rows["time_within_1_m_s"][own]).sum())
        texts = [format_estimate(wilson(k, n), format_percent) for k in (success, wrong, near)]
        lines.append((success / max(n, 1), [f"`{entry.name}`", n, *texts]))
    found = [line for _, line in sorted(lines, key=lambda line: -line[0])]
    print_table(
        ("entry", "runs", "declared within 1 m [%]", "declared elsewhere [%]", "within 1 m at any time [%]"), found
    )


def print_scenarios(data: ReportData) -> None:
    """Print coverage, the best blind entry by approach and the best method by declaration of each scenario."""
    rows, lines = data.rows, []
    blind = [i for i, entry in enumerate(data.entries) if entry.is_blind]
    methods = [i for i, entry in enumerate(data.entries) if not entry.is_blind and entry.name != ORACLE]
    for name in dict.fromkeys(rows["scenario"].tolist()):
        here = ~rows.is_control & (rows["scenario"] == name)
        ratio = _coverage(data, here)
        best_blind = max((_rate(np.isfinite(rows["time_within_1_m_s"]), here & (rows.entry == i)), i) for i in blind)
        best = max((_rate(rows["success"], here & (rows.entry == i)), i) for i in methods)
        pooled = here & np.isin(rows.entry, methods)
        lines.append([
            f"`{name}`", "sweep fails" if ratio == 0 else f"{ratio:.1f}", coverage_stratum(ratio),
            f"{100 * best_blind[0]:.0f} (`{data.entries[best_blind[1]].name}`)",
            f"{100 * best[0]:.0f} (`{data.entries[best[1]].name}`)",
            format_estimate(wilson(int(rows["success"][pooled].sum()), int(pooled.sum())), format_percent),
        ])  # fmt: skip
    heads = (
        "scenario",
        "limit / sweep's median",
        "stratum",
        "best blind, approach [%]",
        "best method [%]",
        "all methods [%]",
    )
    print_table(heads, lines)


def _rate(flags: np.ndarray, own: np.ndarray) -> float:
    return float(flags[own].mean()) if own.any() else -1.0


def _coverage(data: ReportData, here: np.ndarray) -> float:
    sweep = here & (data.rows.entry == next(i for i, entry in enumerate(data.entries) if entry.name == SWEEP))
    return coverage_ratio(data.rows["time_within_1_m_s"][sweep], float(data.rows["time_limit_s"][here][0]))


def print_discrimination(data: ReportData) -> None:
    """Print how well each stratum of coverage tells methods apart."""
    rows = data.rows
    methods = [i for i, entry in enumerate(data.entries) if not entry.is_blind and entry.name != ORACLE]
    scenarios = list(dict.fromkeys(rows["scenario"].tolist()))
    successes, trials = (np.zeros((len(scenarios), len(methods))) for _ in range(2))
    strata = []
    for k, name in enumerate(scenarios):
        here = ~rows.is_control & (rows["scenario"] == name)
        strata.append(coverage_stratum(_coverage(data, here)))
        for j, entry in enumerate(methods):
            own = here & (rows.entry == entry)
            trials[k, j], successes[k, j] = own.sum(), rows["success"][own].sum()
    fits = {fit.stratum: fit for fit in fit_discrimination(successes, trials, strata)}
    lines = [
        [name, fits[name].n_cells, fits[name].slope.n, format_estimate(fits[name].slope, format_score)]
        for name in STRATA
        if name in fits
    ]
    print_table(("stratum", "scenarios", "runs", "slope"), lines)


def main() -> None:
    """Print the tables of a folder of results."""
    parser = argparse.ArgumentParser(description="Prints the tables of the pilot of the open comparison.")
    parser.add_argument("results", type=Path, help="folder of results of open_2026 or open_2026_quick")
    data = load_report_data(parser.parse_args().results)
    print_entries(data)
    print_scenarios(data)
    print_discrimination(data)


if __name__ == "__main__":
    main()
