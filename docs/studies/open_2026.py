"""Prints the tables of the open comparison's study and pilots, and draws the study's figure.

Run with `python docs/studies/open_2026.py RESULTS...`: folders of results of `open_2026` or `open_2026_quick`, one for
each seed. It prints, as Markdown: success by entry; for each scenario coverage, the best blind entry and the best
method; for each family and each stratum of coverage the best method and the best blind entry by declaration; and how
well strata tell methods apart. Of several folders it takes all flights together, and prints three more tables: ranks
with the entries that each one beats, success by seed, and success by group of scenarios.

`--whole FOLDER` takes results of the whole suite with another seed. All tables are then of the entries that flew the
whole suite, and five more are printed: quick and whole side by side; their pairs of entries; false alarms in runs
without gas; all entries in the first repetition of each scenario; and what each axis of the mixtures changes.

Of results without a blind entry it prints success by entry and by place, ranks, and false alarms.

`--figure FILE` draws success by scenario and entry; it needs the extra `plot`.
"""

import argparse
import json
import math
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy import optimize
from scipy.stats import kendalltau

from gslcosim.base.errors import ModelError, ShapeError
from gslcosim_bench.cases.models import LABELS, select_labels
from gslcosim_bench.report.leaderboard import build_leaderboard, compare_within, sampling_units
from gslcosim_bench.report.number_formats import (
    format_estimate,
    format_percent,
    format_points,
    format_ranks,
    format_score,
    format_three_digits,
)
from gslcosim_bench.report.report_data import ReportData, TrialRows, load_report_data
from gslcosim_bench.statistics.estimates import Estimate, student_quantile, two_sided_z
from gslcosim_bench.statistics.rates import difference_of_rates, rate_over_units, wilson

SWEEP, ORACLE = "sweep", "oracle"
# Scenarios of these families have walls or a building.
INDOORS = ("room", "mixed")
# What the warning of a flight says whose vehicle stood on the ground to the end.
GROUNDED = "the vehicle stays"
# Added to repetitions, so that those of two cases or of two seeds differ.
CASES_APART, SEEDS_APART = 10_000, 10_000_000


STRATA_FROM = (0.0, 1.0, 2.0, 4.0)
"""Least ratio of the time limit to the sweep's median of each stratum of coverage; chosen."""

STRATA = ("below 1", "1 to 2", "2 to 4", "4 and more")
"""Names of these strata."""


def coverage_ratio(sweep_s: np.ndarray, limit_s: float) -> float:
    """Return how often blind coverage fits into the time limit: limit over the sweep's median time to the source.

    Args:
        sweep_s: (n,) time in which each run of the sweep came within the radius [s]; nan or infinite without it.
        limit_s: Time limit [s].

    Returns:
        At least 1; 0 where the sweep came there in less than half of the runs; nan without runs.
    """
    times_s = np.asarray(sweep_s, dtype=np.float64)
    if not times_s.size:
        return math.nan
    median_s = float(np.median(np.where(np.isfinite(times_s), times_s, math.inf)))
    return limit_s / median_s if median_s <= limit_s else 0.0


def coverage_stratum(ratio: float) -> str:
    """Return the stratum of a case by its ratio of coverage, one of `STRATA`; empty where it is nan.

    Below 1 a sweep fails in most runs; at 4 and more approach needs no nose.
    """
    return "" if math.isnan(ratio) else STRATA[int(np.searchsorted(STRATA_FROM, ratio, side="right")) - 1]


@dataclass(frozen=True)
class Discrimination:
    """Discrimination of a stratum of cases between entries: the slope of success over ability.

    Attributes:
        stratum: Its label.
        slope: Change of the logit for one standard deviation of ability, with its interval; 0 tells nothing.
        n_cells: Cases in the stratum.
    """

    stratum: str
    slope: Estimate
    n_cells: int


_SLOPE_SD, _DIFFICULTY_SD = 1.0, 3.0
_STEP = 1e-4


def fit_discrimination(
    successes: np.ndarray, trials: np.ndarray, strata: Sequence[str], level: float = 0.95
) -> tuple[Discrimination, ...]:
    """Fit a two-parameter logistic model whose slope is shared by the cases of a stratum.

    P(success) = 1 / (1 + exp(-a_s (b_j - d_i))), b_j ~ N(0, 1), d_i ~ N(0, 3^2), ln a_s ~ N(0, 1)

    The mode is found by L-BFGS; a slope is a_s times the standard deviation of the b_j, and the intervals of its
    logarithm are normal, from the curvature at the mode. With 24 entries and 72 runs of each in a stratum, 90 to 94 %
    of such intervals hold the truth and the slopes are 2 to 4 % too steep; with 8 entries and 6 runs of each, 78 to
    87 %, and 1.6 to 2 times too steep: then read their order only.

    Args:
        successes: (n_cells, n_entries) counts.
        trials: (n_cells, n_entries) counts; 0 where an entry did not fly.
        strata: Label of each cell.

    Returns:
        One for each stratum, in the order in which they come.

    Source:
        Birnbaum 1968, in Lord and Novick, Statistical Theories of Mental Test Scores, chapter 17; priors: Mislevy 1986,
        doi:10.1007/BF02293979. One slope for a stratum: chosen, since a case alone has too few runs.
    Held by:
        extensions/bench/tests/unit/report/test_open_2026_study.py (simulated strata)
    """
    successes, trials = np.asarray(successes, dtype=np.float64), np.asarray(trials, dtype=np.float64)
    if successes.ndim != 2 or successes.shape != trials.shape or len(strata) != len(successes):
        raise ShapeError(
            "successes, trials, strata: expected one shape (n_cells, n_entries) and a stratum for each cell, were "
            f"{successes.shape}, {trials.shape} and {len(strata)}."
        )
    names = list(dict.fromkeys(strata))
    group = np.array([names.index(name) for name in strata])
    n_cells, n_groups = len(successes), len(names)

    def loss_and_gradient(place: np.ndarray) -> tuple[float, np.ndarray]:
        log_a, d, b = np.split(place, [n_groups, n_groups + n_cells])
        a = np.exp(log_a)[group][:, None]
        logit = a * (b[None, :] - d[:, None])
        value = np.sum(trials * np.logaddexp(0.0, logit) - successes * logit)
        value += np.sum(log_a**2) / (2 * _SLOPE_SD**2) + np.sum(d**2) / (2 * _DIFFICULTY_SD**2) + np.sum(b**2) / 2
        excess = trials * 0.5 * (1.0 + np.tanh(0.5 * logit)) - successes
        of_slope = np.bincount(group, weights=np.sum(excess * logit, axis=1), minlength=n_groups)
        gradient = np.concatenate([of_slope, -np.sum(excess * a, axis=1), np.sum(excess * a, axis=0)])
        return float(value), gradient + np.concatenate([log_a / _SLOPE_SD**2, d / _DIFFICULTY_SD**2, b])

    start = np.zeros(n_groups + n_cells + successes.shape[1])
    # Abilities that are all 0 are a saddle: the rates of entries and cases give the side.
    shares = successes.sum(axis=0) / np.maximum(trials.sum(axis=0), 1.0)
    start[n_groups + n_cells :] = shares - shares.mean()
    found = optimize.minimize(
        loss_and_gradient, start, jac=True, method="L-BFGS-B", options={"maxiter": 5000, "ftol": 1e-13, "gtol": 1e-7}
    )
    place = np.asarray(found.x)
    if np.abs(loss_and_gradient(place)[1]).max() > 1e-2:
        raise ModelError("Two-parameter logistic model: not converged. Give more runs of each case.")
    steps = np.eye(place.size) * _STEP
    curvature = np.stack(
        [(loss_and_gradient(place + s)[1] - loss_and_gradient(place - s)[1]) / (2 * _STEP) for s in steps]
    )
    covariance = np.linalg.inv(0.5 * (curvature + curvature.T))
    # The mode has all abilities too close together and all slopes too steep; their product is what the runs tell.
    b = place[n_groups + n_cells :]
    of_scale = np.zeros_like(place)
    of_scale[n_groups + n_cells :] = (b - b.mean()) / (b.size * b.var())
    log_slope = place[:n_groups] + np.log(b.std())
    directions = np.eye(n_groups, place.size) + of_scale
    error = np.sqrt(np.einsum("ij,jk,ik->i", directions, covariance, directions))
    z = two_sided_z(level)
    return tuple(
        Discrimination(
            stratum=name,
            slope=Estimate(
                float(np.exp(log_slope[k])), float(np.exp(log_slope[k] - z * error[k])),
                float(np.exp(log_slope[k] + z * error[k])),
                int(trials[group == k].sum()),
            ),
            n_cells=int(np.sum(group == k)),
        )
        for k, name in enumerate(names)
    )  # fmt: skip


def select_flights(data: ReportData, own: np.ndarray) -> ReportData:
    """Return some flights as results of their own, with the entries that flew any of them."""
    names = [entry.name for i, entry in enumerate(data.entries) if (own & (data.rows.entry == i)).any()]
    columns = {name: column[own] for name, column in data.rows.columns.items()}
    entries = tuple(entry for entry in data.entries if entry.name in names)
    return replace(data, entries=entries, rows=TrialRows.of_columns(columns, names))


def leave_out_grounded(data: ReportData) -> ReportData:
    """Return results without the cases whose start no vehicle left, whoever flew it.

    Starts were drawn beside thin walls until 28 November 2026, where the autopilot does not take off.
    """
    warnings = data.rows["warnings"].tolist()
    grounded = np.array([GROUNDED in text for text in warnings])
    left_out = np.isin(data.rows.unit, data.rows.unit[grounded])
    if left_out.any():
        n = len(set(data.rows.unit[left_out].tolist()))
        sys.stderr.write(f"{data.folder}: {n} case{'s' * (n != 1)} left out, in which no vehicle takes off.\n")
    return select_flights(data, ~left_out)


def pool_results(folders: Sequence[ReportData]) -> ReportData:
    """Return the flights of several seeds as one: a case is a scenario, and repetitions of two seeds are apart."""
    names = list(dict.fromkeys(entry.name for data in folders for entry in data.entries))
    entries = tuple(next(e for data in folders for e in data.entries if e.name == name) for name in names)
    shared = [name for name in folders[0].rows.columns if all(name in data.rows.columns for data in folders)]
    columns = {name: np.concatenate([data.rows[name] for data in folders]) for name in shared}
    seeds = np.concatenate([np.full(len(data.rows), k) for k, data in enumerate(folders)])
    # Flights of one scenario in two rooms, or with two seeds, are no pair.
    _, cases = np.unique(columns["case"], return_inverse=True)
    columns["repetition"] = columns["repetition"] + CASES_APART * cases + SEEDS_APART * seeds
    # Rooms drawn anew for each seed would count twice as much as open ground, which is one case for all seeds.
    columns["case"] = columns["scenario"]
    return replace(folders[0], entries=entries, rows=TrialRows.of_columns(columns, names))


def select_complete(data: ReportData) -> ReportData:
    """Return the flights of the entries that flew all cases and repetitions with gas."""
    n = np.bincount(data.rows.entry[~data.rows.is_control], minlength=len(data.entries))
    return select_flights(data, np.isin(data.rows.entry, np.flatnonzero(n == n.max())))


def select_quick(data: ReportData) -> ReportData:
    """Return the first repetition of each scenario in its first room: what the quick profile flies of a seed."""
    rows = data.rows
    first = {}
    for scenario, case in zip(rows["scenario"].tolist(), rows["case"].tolist()):
        first.setdefault(scenario, case)
    in_first = rows["case"] == np.array([first[scenario] for scenario in rows["scenario"].tolist()])
    return select_flights(data, ~rows.is_control & in_first & (rows["repetition"] == rows["repetition"].min()))


def print_ranks(data: ReportData) -> None:
    """Print ranks, success over whole rooms, outcomes, and what each entry beats, of one family-wise comparison."""
    rows = data.rows
    table, comparison = build_leaderboard(data, np.ones(len(rows), bool))
    beats: dict[int, list[str]] = {row.entry: [] for row in table}
    for pair in comparison.pairs:
        if pair.verdict:
            winner, loser = (pair.a, pair.b) if pair.verdict > 0 else (pair.b, pair.a)
            beats[winner].append(f"`{data.entries[loser].name}`")
    lines = []
    for row in sorted(table, key=lambda row: (row.rank, row.last_rank, -row.success.value)):
        own = ~rows.is_control & (rows.entry == row.entry)
        errors_m = rows["declared_error_in_plane_m"][own]
        known_m = errors_m[np.isfinite(errors_m)]
        lines.append([
            format_ranks(row.rank, row.last_rank), f"`{data.entries[row.entry].name}`", row.n,
            format_estimate(row.success, format_percent),
            format_percent(float((rows["declared"][own] & ~rows["success"][own]).mean())),
            format_percent(float((~rows["declared"][own]).mean())),
            format_three_digits(float(np.median(known_m))) if known_m.size else "",
            format_percent(float(np.isfinite(rows["time_within_1_m_s"][own]).mean())),
            _list_beaten(beats[row.entry], len(table) - 1),
        ])  # fmt: skip
    heads = (
        "rank", "entry", "runs", "declared within 1 m [%]", "declared elsewhere [%]", "declared nothing [%]",
        "median error of a declaration [m]", "within 1 m at any time [%]", "beats",
    )  # fmt: skip
    print_table(heads, lines)


def _list_beaten(names: Sequence[str], n_others: int) -> str:
    if len(names) == n_others:
        return "all"
    return ", ".join(names) or "none" if len(names) < 6 else f"{len(names)} entries"


def print_seeds(folders: Sequence[ReportData], pooled: ReportData) -> None:
    """Print success of each entry by seed with the difference of the first two, and how far their orders agree."""
    names = [entry.name for entry in pooled.entries if entry.name != ORACLE]
    counts = {}
    for name in names:
        counts[name] = []
        for data in folders:
            own = ~data.rows.is_control & (data.rows.entry == find_entry(data, name))
            counts[name].append((int(data.rows["success"][own].sum()), int(own.sum())))
    lines, apart = [], 0
    for name in sorted(names, key=lambda name: -sum(k for k, _ in counts[name])):
        first, second = counts[name][:2]
        difference = difference_of_rates(*first, *second)
        apart += difference.low > 0.0 or difference.high < 0.0
        shown = [f"{k} of {n}" for k, n in counts[name]]
        lines.append([f"`{name}`", *shown, format_estimate(difference, format_points)])
    heads = ("entry", *(f"seed {chr(65 + k)}" for k in range(len(folders))), "A less B [points]")
    print_table(heads, lines)
    rates = np.array([[k / n for k, n in counts[name]] for name in names])
    tau = float(kendalltau(rates[:, 0], rates[:, 1]).statistic)
    swapped = sum(
        bool((rates[i, 0] - rates[j, 0]) * (rates[i, 1] - rates[j, 1]) < 0.0)
        for i, j in combinations(range(len(names)), 2)
    )
    sys.stdout.write(
        f"Kendall's tau of the two orders {tau:.2f}; {swapped} of {len(names) * (len(names) - 1) // 2} pairs change "
        f"their order; the difference of {apart} of {len(names)} entries excludes zero.\n\n"
    )


def print_false_alarms(data: ReportData) -> None:
    """Print how often each entry declared a source in runs without gas."""
    rows, lines = data.rows, []
    for i, entry in enumerate(data.entries):
        own = np.flatnonzero(rows.is_control & (rows.entry == i))
        if not own.size:
            continue
        alarms = rate_over_units(rows["declared"][own], sampling_units(rows, own))
        lines.append((alarms.value, [f"`{entry.name}`", own.size, format_estimate(alarms, format_percent)]))
    found = [line for _, line in sorted(lines, key=lambda line: line[0])]
    print_table(("entry", "runs without gas", "declared a source [%]"), found)


def print_quick_and_whole(quick: ReportData, same: ReportData, whole: ReportData) -> None:
    """Print success in the quick profile of some seeds and in the whole suite of another, and how far they agree.

    Args:
        quick: The quick profile of other seeds.
        same: The quick profile of the seed of the whole suite.
        whole: The whole suite.
    """
    shared = {entry.name for entry in quick.entries} & {entry.name for entry in whole.entries} - {ORACLE}
    names = [entry.name for entry in whole.entries if entry.name in shared]
    profiles = (quick, same, whole)
    rates = {name: [_find_success(data, name) for data in profiles] for name in names}
    heads = ("entry", "quick, other seeds [%]", "quick, same seed [%]", "whole [%]")
    lines = [[f"`{name}`", *(format_estimate(r, format_percent) for r in rates[name])] for name in names]
    print_table(heads, [line for _, line in sorted(zip([-rates[n][2].value for n in names], lines))])
    values = np.array([[r.value for r in rates[name]] for name in names])
    for label, data, column in (("other seeds", quick, 0), ("the same seed", same, 1)):
        tau = float(kendalltau(values[:, column], values[:, 2]).statistic)
        of_quick, of_whole = _compare_pairs(data, names), _compare_pairs(whole, names)
        pairs = [(*of_quick[pair], *of_whole[pair]) for pair in of_quick]
        n_inside = sum(short.low <= long.value <= short.high for short, _, long, _ in pairs)
        n_decided = sum(decision != 0 for *_, decision in pairs)
        n_same = sum(verdict * decision > 0 for _, verdict, _, decision in pairs)
        n_opposite = sum(verdict * decision < 0 for _, verdict, _, decision in pairs)
        sys.stdout.write(
            f"Quick profile of {label}: Kendall's tau with the whole suite {tau:.2f}; the interval of {n_inside} of "
            f"{len(pairs)} differences holds that of the whole suite; of {n_decided} pairs that the whole suite tells "
            f"apart it tells {n_same}, and {n_opposite} the other way round.\n\n"
        )


def _find_success(data: ReportData, name: str) -> Estimate:
    own = np.flatnonzero(~data.rows.is_control & (data.rows.entry == find_entry(data, name)))
    return rate_over_units(data.rows["success"][own], sampling_units(data.rows, own))


# The difference in success of each two entries and which is better, in one family of these entries.
def _compare_pairs(data: ReportData, names: Sequence[str]) -> dict[tuple[str, str], tuple[Estimate, int]]:
    entries = [find_entry(data, name) for name in names]
    compared = compare_within(data.rows, np.ones(len(data.rows), bool), entries)
    return {
        (data.entries[pair.a].name, data.entries[pair.b].name): (pair.differences["success"], pair.verdict)
        for pair in compared.pairs
    }


def print_places(data: ReportData) -> None:
    """Print success of each entry on open ground, in rooms, and in mixtures, over whole rooms."""
    rows, lines = data.rows, []
    groups = {
        "open ground": ~np.isin(rows["family"], INDOORS),
        "rooms": rows["family"] == "room",
        "mixtures": rows["family"] == "mixed",
    }
    for i, entry in enumerate(data.entries):
        if entry.name == ORACLE:
            continue
        cells, total = [], 0.0
        for here in groups.values():
            own = np.flatnonzero(here & ~rows.is_control & (rows.entry == i))
            rate = rate_over_units(rows["success"][own], sampling_units(rows, own))
            total += float(rows["success"][own].sum())
            cells.append(format_estimate(rate, format_percent))
        lines.append((-total, [f"`{entry.name}`", *cells]))
    print_table(("entry", *groups), [line for _, line in sorted(lines, key=lambda line: line[0])])


def draw_figure(data: ReportData, path: Path) -> None:
    """Draw the share of runs with success, a row for each scenario and a column for each entry."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    rows, scenarios = data.rows, list_scenarios(data)
    own = {i: ~rows.is_control & (rows.entry == i) for i, e in enumerate(data.entries) if e.name != ORACLE}
    order = sorted(own, key=lambda i: -float(rows["success"][own[i]].mean()))
    share = np.array(
        [[_rate(rows["success"], own[i] & (rows["scenario"] == name)) for i in order] for name in scenarios]
    )
    figure, axes = plt.subplots(figsize=(1.6 + 0.62 * len(order), 1.2 + 0.24 * len(scenarios)), layout="constrained")
    drawn = axes.imshow(np.where(share < 0.0, np.nan, share), cmap="Greens", vmin=0.0, vmax=1.0, aspect="auto")
    axes.set_xticks(range(len(order)), [data.entries[i].name for i in order], rotation=40, ha="right", fontsize=8)
    axes.set_yticks(range(len(scenarios)), scenarios, fontsize=8)
    families = [str(rows["family"][rows["scenario"] == name][0]) for name in scenarios]
    for k in range(1, len(scenarios)):
        if families[k] != families[k - 1]:
            axes.axhline(k - 0.5, color="0.6", linewidth=0.6)
    figure.colorbar(drawn, ax=axes, label="share of runs that declare within 1 m", shrink=0.5)
    figure.savefig(path, dpi=130)
    plt.close(figure)


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


def find_entry(data: ReportData, name: str) -> int:
    """Return the index of the entry with a name."""
    return next(i for i, entry in enumerate(data.entries) if entry.name == name)


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
        pooled = np.flatnonzero(here & np.isin(rows.entry, methods))
        # Flights of several methods in one plume are not independent.
        of_all = rate_over_units(rows["success"][pooled], sampling_units(rows, pooled))
        lines.append([
            f"`{name}`", _describe_coverage(ratio), coverage_stratum(ratio),
            f"{100 * best_blind[0]:.0f} (`{data.entries[best_blind[1]].name}`)",
            f"{100 * best[0]:.0f} (`{data.entries[best[1]].name}`)",
            format_estimate(of_all, format_percent),
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
    sweep = here & (data.rows.entry == find_entry(data, SWEEP))
    return coverage_ratio(data.rows["time_within_1_m_s"][sweep], float(data.rows["time_limit_s"][here][0]))


def print_mixture_effects(data: ReportData) -> None:
    """Print what each axis of the mixtures changes in the success of methods, of an additive fit over their rooms.

    The eight mixtures are an orthogonal array (L8), so effects of axes do not mix. A cell is a mixture in one room;
    what the fit leaves over of cells gives the intervals (Student's t).
    """
    rows = data.rows
    of_methods = ~rows.is_control & (rows["family"] == "mixed") & np.isin(rows.entry, find_methods(data))
    cells = sorted(set(zip(rows["varied"][of_methods].tolist(), rows["environment_hash"][of_methods].tolist())))
    if not cells:
        return
    labels = [select_labels(json.loads(text)) for text, _ in cells]
    success = np.array([
        rows["success"][of_methods & (rows["varied"] == text) & (rows["environment_hash"] == room)].mean()
        for text, room in cells
    ])  # fmt: skip
    axes = {axis: sorted({str(each[axis]) for each in labels}, key=_comes_later) for axis in labels[0]}
    axes = {axis: levels for axis, levels in axes.items() if len(levels) == 2}
    design = np.array([[1.0, *(str(each[axis]) == axes[axis][1] for axis in axes)] for each in labels])
    freedom = len(cells) - design.shape[1]
    if freedom < 1:
        return
    fitted, *_ = np.linalg.lstsq(design, success, rcond=None)
    variance = float(((success - design @ fitted) ** 2).sum()) / freedom
    half = student_quantile(0.975, freedom) * np.sqrt(variance * np.diag(np.linalg.inv(design.T @ design)))
    lines = [
        [f"`{axis.removeprefix(LABELS)}`", f"{levels[1]} in place of {levels[0]}",
         format_estimate(Estimate(e, e - h, e + h, len(cells)), format_points)]
        for (axis, levels), e, h in zip(axes.items(), fitted[1:], half[1:])
    ]  # fmt: skip
    print_table(("axis", "change", "success of methods [points]"), lines)


# The core's levels come first.
def _comes_later(level: str) -> tuple[bool, str]:
    return level not in ("boxes", "steady", "one", "neutral", "pid", "exact", "point"), level


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
    """Print the tables of folders of results."""
    parser = argparse.ArgumentParser(description="Prints the tables of the open comparison.")
    parser.add_argument("results", type=Path, nargs="+", help="folder of results of open_2026 or open_2026_quick")
    parser.add_argument("--whole", type=Path, help="folder of results of open_2026 with another seed")
    parser.add_argument("--figure", type=Path, help="file of the figure, .png or .svg")
    options = parser.parse_args()
    folders = [leave_out_grounded(load_report_data(folder)) for folder in options.results]
    data = pool_results(folders) if len(folders) > 1 else folders[0]
    if options.whole:
        quick, flown = data, leave_out_grounded(load_report_data(options.whole))
        data = pool_results([select_complete(flown)])
        print_quick_and_whole(quick, pool_results([select_quick(flown)]), data)
        print_false_alarms(data)
        print_ranks(pool_results([select_quick(flown)]))
    if len(folders) > 1 or options.whole:
        print_ranks(data)
    if len(folders) > 1:
        print_seeds(folders, pool_results(folders))
    if len(folders) > 1 or options.whole:
        print_places(data)
    if options.figure:
        draw_figure(data, options.figure)
    print_entries(data)
    if not find_blind(data):
        # Without a sweep there is no coverage to compare with.
        print_false_alarms(data)
        print_ranks(pool_results([select_complete(data)]))
        print_places(data)
        return
    print_scenarios(data)
    if options.whole:
        print_mixture_effects(data)
    print_groups(data)
    print_discrimination(data)


if __name__ == "__main__":
    main()
