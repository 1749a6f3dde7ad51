"""Prints the tables of the pilot of the open comparison, as docs/benchmark/open_2026.md has them.

Run with `python docs/studies/open_2026_pilot.py RESULTS`, a folder of results of `open_2026` or `open_2026_quick`. It
prints, as Markdown: success by entry; for each scenario coverage, the best blind entry and the best method; for each
family and each stratum of coverage the best method and the best blind entry by declaration; and how well strata tell
methods apart.
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


def find_blind(data: ReportData) -> list[int]:
    """Return which entries are blind."""
    return [i for i, entry in enumerate(data.entries) if entry.is_blind]


def find_methods(data: ReportData) -> list[int]:
    """Return which entries smell, without the oracle."""
    return [i for i, entry in enumerate(data.entries) if not entry.is_blind and entry.name != ORACLE]


def list_scenarios(data: ReportData) -> list[str]:
    """Return the names of the scenarios, in the order in which they were flown."""
    return list(dict.fromkeys(data.rows["scenario"].tolist()))


def print_scenarios(data: ReportData) -> None:
    """Print coverage, the best blind entry by approach and the best method by declaration of each scenario."""
    rows, lines = data.rows, []
    blind, methods = find_blind(data), find_methods(data)
    for name in list_scenarios(data):
        here = _runs_of(data, name)
        ratio = _coverage(data, here)
        best_blind = max((_rate(np.isfinite(rows["time_within_1_m_s"]), here & (rows.entry == i)), i) for i in blind)
        best = max((_rate(rows["success"], here & (rows.entry == i)), i) for i in methods)
        pooled = here & np.isin(rows.entry, methods)
        lines.append([
            f"`{name}`", _describe_coverage(ratio), coverage_stratum(ratio),
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


def _describe_coverage(ratio: float) -> str:
    return "no sweep" if np.isnan(ratio) else "sweep fails" if ratio == 0 else f"{ratio:.1f}"


def _rate(flags: np.ndarray, own: np.ndarray) -> float:
    return float(flags[own].mean()) if own.any() else -1.0


def _coverage(data: ReportData, here: np.ndarray) -> float:
    sweep = here & (data.rows.entry == next(i for i, entry in enumerate(data.entries) if entry.name == SWEEP))
    return coverage_ratio(data.rows["time_within_1_m_s"][sweep], float(data.rows["time_limit_s"][here][0]))


def print_groups(data: ReportData) -> None:
    """Print the best method and the best blind entry by declaration of each family, each stratum and all together."""
    rows = data.rows
    strata = np.array([coverage_stratum(_coverage(data, _runs_of(data, name))) for name in list_scenarios(data)])
    index = {name: i for i, name in enumerate(list_scenarios(data))}
    stratum = strata[[index[name] for name in rows["scenario"].tolist()]]
    groups = [("all", np.ones(len(rows.entry), bool))]
    groups += [(f"family `{name}`", rows["family"] == name) for name in dict.fromkeys(rows["family"].tolist())]
    groups += [(f"stratum {name}", stratum == name) for name in STRATA if (stratum == name).any()]
    lines = []
    for label, here in groups:
        own = here & ~rows.is_control
        n_scenarios = len(set(rows["scenario"][own].tolist()))
        lines.append(
            [label, n_scenarios, *(_best(data, own, entries) for entries in (find_methods(data), find_blind(data)))]
        )
    print_table(("", "scenarios", "best method, declared within 1 m [%]", "best blind entry, the same [%]"), lines)


# Its name, its rate and interval; of equal ones the first.
def _best(data: ReportData, here: np.ndarray, entries: Sequence[int]) -> str:
    best = max(entries, key=lambda i: _rate(data.rows["success"], here & (data.rows.entry == i)))
    own = here & (data.rows.entry == best)
    rate = wilson(int(data.rows["success"][own].sum()), int(own.sum()))
    return f"`{data.entries[best].name}` {format_estimate(rate, format_percent)}"


def _runs_of(data: ReportData, scenario: str) -> np.ndarray:
    return ~data.rows.is_control & (data.rows["scenario"] == scenario)


def print_discrimination(data: ReportData) -> None:
    """Print how well each stratum of coverage tells methods apart."""
    rows = data.rows
    methods, scenarios = find_methods(data), list_scenarios(data)
    successes, trials = (np.zeros((len(scenarios), len(methods))) for _ in range(2))
    strata = []
    for k, name in enumerate(scenarios):
        here = _runs_of(data, name)
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
    print_groups(data)
    print_discrimination(data)


if __name__ == "__main__":
    main()
